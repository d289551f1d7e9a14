//! `#[derive(Choice)]`.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{Data, DeriveInput, Error, Fields};

pub fn expand(input: &DeriveInput) -> Result<TokenStream, Error> {
    let name = &input.ident;
    let Data::Enum(data) = &input.data else {
        return Err(Error::new_spanned(name, "only an enum can be a choice"));
    };
    let mut idents = Vec::new();
    let mut words = Vec::new();
    for variant in &data.variants {
        if !matches!(variant.fields, Fields::Unit) {
            return Err(Error::new_spanned(variant, "a choice is a word: a variant has no fields"));
        }
        words.push(word(&variant.ident.to_string()));
        idents.push(&variant.ident);
    }
    if idents.is_empty() {
        return Err(Error::new_spanned(name, "a choice needs a variant"));
    }
    let path = quote!(::stillpoint_operator::params);
    Ok(quote! {
        #[automatically_derived]
        impl #path::ParamValue for #name {
            const TYPE: #path::ParamType = #path::ParamType::Choice(&[#(#words),*]);
            fn read(
                node: &#path::Node,
                field: &#path::ParamField,
                reader: &#path::ParamReader<'_>,
            ) -> ::core::option::Option<Self> {
                match reader.choice(node, field, &[#(#words),*])? {
                    #(#words => ::core::option::Option::Some(Self::#idents),)*
                    _ => ::core::option::Option::None,
                }
            }
            fn resolved(&self) -> #path::json::Value {
                #path::json::Value::from(match self { #(Self::#idents => #words),* })
            }
        }
    })
}

/// `LockStep` as `lock_step`.
fn word(variant: &str) -> String {
    let mut word = String::new();
    for c in variant.chars() {
        if c.is_uppercase() && !word.is_empty() {
            word.push('_');
        }
        word.extend(c.to_lowercase());
    }
    word
}
