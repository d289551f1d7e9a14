//! `#[derive(Codes)]`: the names of an enumeration or of bits.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{Data, DeriveInput, Error, Fields, LitStr};

use crate::doc;

pub fn expand(input: &DeriveInput) -> Result<TokenStream, Error> {
    let name = &input.ident;
    let Data::Enum(of) = &input.data else {
        return Err(Error::new(name.span(), "only an enum without fields names codes"));
    };
    let (mut rows, mut pairs, mut idents) = (Vec::new(), Vec::new(), Vec::new());
    let mut words: Vec<String> = Vec::new();
    for variant in &of.variants {
        let ident = &variant.ident;
        if !matches!(variant.fields, Fields::Unit) || variant.discriminant.is_none() {
            return Err(Error::new(
                ident.span(),
                "write the number of each code: `Name = 1`, without fields",
            ));
        }
        let mut word = spaced(&ident.to_string());
        for attribute in variant.attrs.iter().filter(|a| a.path().is_ident("word")) {
            word = attribute.parse_args::<LitStr>()?.value();
        }
        if !is_word(&word) {
            let what = "a word of a code has small letters, digits, spaces and `_`, and begins with a letter";
            return Err(Error::new(ident.span(), what));
        }
        if words.contains(&word) {
            return Err(Error::new(ident.span(), format!("two codes have the word `{word}`")));
        }
        let about = doc::text(&variant.attrs);
        rows.push(
            quote!(::stillpoint_samples::Code { word: #word, value: #name::#ident as u64, about: #about }),
        );
        pairs.push(quote!((#word, #name::#ident)));
        idents.push(ident);
        words.push(word);
    }
    Ok(quote! {
        impl ::stillpoint_samples::Codes for #name {
            const CODES: &'static [::stillpoint_samples::Code] = &[#(#rows),*];
        }
        impl #name {
            /// All with their words.
            pub const ALL: &'static [(&'static str, #name)] = &[#(#pairs),*];
            /// The word that people read.
            pub const fn word(self) -> &'static str {
                match self { #(Self::#idents => #words,)* }
            }
            /// The code of this number; `None` for a number that no build of this version wrote.
            pub const fn from_number(number: u32) -> Option<Self> {
                #(if number == Self::#idents as u32 { return Some(Self::#idents); })*
                None
            }
        }
    })
}

/// `PoseStale` as `pose stale`.
fn spaced(ident: &str) -> String {
    let mut word = String::new();
    for letter in ident.chars() {
        if letter.is_uppercase() && !word.is_empty() {
            word.push(' ');
        }
        word.extend(letter.to_lowercase());
    }
    word
}

/// Whether a word can be the end of a constant's name in a message text.
fn is_word(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_lowercase())
        && word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == ' ' || c == '_')
}
