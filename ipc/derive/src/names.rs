//! The attributes of a field that say what its numbers mean.

use proc_macro2::TokenStream;
use quote::quote;
use syn::punctuated::Punctuated;
use syn::spanned::Spanned;
use syn::{Error, Field, LitInt, LitStr, Path, Token, Type};

/// The names of a field's numbers, as tokens.
pub fn of(field: &Field, is_integer: bool) -> Result<TokenStream, Error> {
    let mut found = quote!(::stillpoint_samples::Names::None);
    let mut attributes = field
        .attrs
        .iter()
        .filter(|a| ["codes", "bits", "each", "parts", "rows"].iter().any(|known| a.path().is_ident(known)));
    let Some(attribute) = attributes.next() else { return Ok(found) };
    if let Some(more) = attributes.next() {
        return Err(Error::new(
            more.span(),
            "a field has one kind of names: codes, bits, each, parts or rows",
        ));
    }
    let is = |name: &str| attribute.path().is_ident(name);
    let is_array = matches!(field.ty, Type::Array(_));
    let refuse = |what: &str| Err(Error::new(attribute.span(), what));
    if is("codes") || is("bits") || is("each") {
        if is_array || !is_integer {
            return refuse("codes and bits are single integers");
        }
    } else if !is_array {
        return refuse("only an array has parts and rows");
    }
    if is("each") {
        let part: LitStr = attribute.parse_args()?;
        found = quote!(::stillpoint_samples::Names::Each(#part));
    } else if is("rows") {
        let sizes = attribute.parse_args_with(Punctuated::<LitInt, Token![,]>::parse_terminated)?;
        let [rows, columns] = [sizes.first(), sizes.last()];
        if sizes.len() != 2 {
            return refuse("write the numbers of rows and columns: #[rows(12, 6)]");
        }
        let Type::Array(array) = &field.ty else { return refuse("only an array has rows") };
        let length = &array.len;
        found = quote!({
            const _: () = assert!(#rows * #columns == #length, "rows times columns is not the array's length");
            ::stillpoint_samples::Names::Rows(#rows, #columns)
        });
    } else {
        let kind: Path = attribute.parse_args()?;
        let table = quote!(<#kind as ::stillpoint_samples::Codes>::CODES);
        found = if is("codes") {
            quote!(::stillpoint_samples::Names::Codes(#table))
        } else if is("bits") {
            quote!(::stillpoint_samples::Names::Bits(#table))
        } else {
            quote!(::stillpoint_samples::Names::Parts(#table))
        };
    }
    Ok(found)
}
