//! `#[derive(Params)]`.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{Data, DeriveInput, Error, Fields};

use crate::attributes::{Attributes, Names};

pub fn expand(input: &DeriveInput) -> Result<TokenStream, Error> {
    let name = &input.ident;
    let Data::Struct(data) = &input.data else {
        return Err(Error::new_spanned(
            name,
            "only a struct can be parameters; for words derive Choice on an enum",
        ));
    };
    let Fields::Named(fields) = &data.fields else {
        return Err(Error::new_spanned(name, "name the fields: the config does"));
    };
    if !input.generics.params.is_empty() {
        return Err(Error::new_spanned(&input.generics, "parameters have no generics: their schema is one"));
    }
    let mut rows = Vec::new();
    let mut reads = Vec::new();
    let mut idents = Vec::new();
    let mut keys = Vec::new();
    for (i, field) in fields.named.iter().enumerate() {
        let Some(ident) = &field.ident else {
            return Err(Error::new_spanned(field, "name the field"));
        };
        let attributes = Attributes::of(field)?;
        let ty = &field.ty;
        let key = ident.to_string().trim_start_matches("r#").to_owned();
        rows.push(row(&key, ty, &attributes));
        reads.push(quote!(let #ident = reader.field::<#ty>(&FIELDS[#i]);));
        idents.push(ident);
        keys.push(key);
    }
    let path = quote!(::stillpoint_operator::params);
    let json = quote!(#path::json);
    Ok(quote! {
        const _: () = {
            const FIELDS: &[#path::ParamField] = &[#(#rows),*];

            #[automatically_derived]
            impl #path::Params for #name {
                const FIELDS: &'static [#path::ParamField] = FIELDS;
                fn read(reader: &mut #path::ParamReader<'_>) -> ::core::option::Option<Self> {
                    reader.open(FIELDS);
                    #(#reads)*
                    let value = Self { #(#idents: #idents?),* };
                    reader.keep(#path::ParamValue::resolved(&value));
                    ::core::option::Option::Some(value)
                }
            }

            #[automatically_derived]
            impl #path::ParamValue for #name {
                const TYPE: #path::ParamType = #path::ParamType::Group(FIELDS);
                const PRESENCE: #path::Presence = #path::Presence::Group;
                fn read(
                    node: &#path::Node,
                    field: &#path::ParamField,
                    reader: &#path::ParamReader<'_>,
                ) -> ::core::option::Option<Self> {
                    reader.group(node, field)
                }
                fn absent(
                    field: &#path::ParamField,
                    reader: &#path::ParamReader<'_>,
                ) -> ::core::option::Option<Self> {
                    reader.absent_group(field)
                }
                fn resolved(&self) -> #json::Value {
                    let mut map = #json::Map::new();
                    #(map.insert(#keys.into(), #path::ParamValue::resolved(&self.#idents));)*
                    #json::Value::Object(map)
                }
            }
        };
    })
}

fn row(key: &str, ty: &syn::Type, attributes: &Attributes) -> TokenStream {
    let path = quote!(::stillpoint_operator::params);
    let option = |text: &Option<String>| match text {
        Some(text) => quote!(::core::option::Option::Some(#text)),
        None => quote!(::core::option::Option::None),
    };
    let about = &attributes.about;
    let unit = attributes.unit.as_ref().map_or(String::new(), syn::LitStr::value);
    let (default, min, above, max) = (
        option(&attributes.default),
        option(&attributes.min),
        option(&attributes.above),
        option(&attributes.max),
    );
    let choices = &attributes.choices;
    let names = match &attributes.names {
        Names::Nothing => quote!(Nothing),
        Names::File => quote!(File),
        Names::Files(pattern) => quote!(Files(#pattern)),
    };
    let is_live = attributes.is_live;
    quote!(#path::ParamField {
        name: #key,
        about: #about,
        ty: <#ty as #path::ParamValue>::TYPE,
        presence: <#ty as #path::ParamValue>::PRESENCE,
        unit: #unit,
        default: #default,
        min: #min,
        above: #above,
        max: #max,
        choices: &[#(#choices),*],
        names: #path::Names::#names,
        is_live: #is_live,
    })
}
