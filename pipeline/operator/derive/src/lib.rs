//! `#[derive(Params)]` and `#[derive(Choice)]`: typed parameters of operators.
//!
//! The generated code names `::stillpoint_operator`, which re-exports both derives with the traits behind them.

mod attributes;
mod choice;
mod params;

use proc_macro::TokenStream;
use syn::{DeriveInput, Error, parse_macro_input};

/// Derives `stillpoint_operator::Params` for a struct with named fields.
///
/// The doc comment of a field is its description. `#[param(...)]` takes `unit`, `default`, `min`, `above`, `max` (as a
/// config would write them), `choices("a", "b")`, `file`, `files`, and `live` for one that changes while the operator
/// runs.
#[proc_macro_derive(Params, attributes(param))]
pub fn derive_params(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    params::expand(&input).unwrap_or_else(Error::into_compile_error).into()
}

/// Derives a parameter that is one of some words, for an enum without fields. A variant `LockStep` is written
/// `lock_step`.
#[proc_macro_derive(Choice)]
pub fn derive_choice(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    choice::expand(&input).unwrap_or_else(Error::into_compile_error).into()
}
