//! `#[derive(Layout)]`: one definition of a sample's bytes for shared memory, recording and wire.
//!
//! The derive refuses a struct whose `repr(C)` bytes would differ from its little-endian XCDR1 body: fields must be
//! fixed-size numbers or arrays of them, in falling order of alignment, without padding. It emits the field table from
//! which the layout hash, the type name and the `ros2msg` text are made.
//!
//! `#[derive(Codes)]`: the names of an enumeration or of bits, which fields of samples refer to.

mod codes;
mod doc;
mod names;

use proc_macro::TokenStream;
use quote::quote;
use syn::spanned::Spanned;
use syn::{Data, DeriveInput, Error, Expr, Fields, Lit, LitStr, Type, parse_macro_input};

/// Derives `stillpoint_samples::Layout`. Each field may carry `#[unit("m")]`; a field without one is a plain number.
///
/// A field that holds a code says once what its numbers mean:
/// - `#[codes(Kind)]`: the number is one of `Kind`, which derives `Codes`;
/// - `#[bits(Kind)]`: each bit is one of `Kind`;
/// - `#[each("valve")]`: bit i is set for part i, such as valve 0;
/// - `#[parts(Kind)]`: value i of the array belongs to the code i of `Kind`, such as an axis;
/// - `#[rows(12, 12)]`: the array is a matrix, row by row.
#[proc_macro_derive(Layout, attributes(unit, codes, bits, each, parts, rows))]
pub fn derive_layout(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    expand(&input).unwrap_or_else(|e| e.to_compile_error()).into()
}

/// Derives `stillpoint_samples::Codes` for an enum without fields, with `ALL`, `word` and `from_number`.
///
/// The word of a variant is its name in small letters (`PoseStale`: `pose stale`), or that of `#[word("pose_stale")]`. Its
/// doc comment says what the code means.
#[proc_macro_derive(Codes, attributes(word))]
pub fn derive_codes(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    codes::expand(&input).unwrap_or_else(|e| e.to_compile_error()).into()
}

struct Primitive {
    variant: &'static str,
    align: usize,
}

impl Primitive {
    fn is_integer(&self) -> bool {
        !self.variant.starts_with('F')
    }
}

fn primitive(name: &str) -> Option<Primitive> {
    let (variant, align) = match name {
        "u8" => ("U8", 1),
        "i8" => ("I8", 1),
        "u16" => ("U16", 2),
        "i16" => ("I16", 2),
        "u32" => ("U32", 4),
        "i32" => ("I32", 4),
        "u64" => ("U64", 8),
        "i64" => ("I64", 8),
        "f32" => ("F32", 4),
        "f64" => ("F64", 8),
        _ => return None,
    };
    Some(Primitive { variant, align })
}

/// The primitive and the array length (as tokens; 0 for a single value) of a field's type.
fn field_type(ty: &Type) -> Result<(Primitive, proc_macro2::TokenStream), Error> {
    let refuse = || {
        Error::new(
            ty.span(),
            "a sample holds only u8..u64, i8..i64, f32, f64 and arrays of them: anything else has no fixed bytes",
        )
    };
    let single = |ty: &Type| match ty {
        Type::Path(p) => p.path.get_ident().and_then(|i| primitive(&i.to_string())),
        _ => None,
    };
    match ty {
        Type::Array(a) => {
            let p = single(&a.elem).ok_or_else(refuse)?;
            if let Expr::Lit(l) = &a.len
                && let Lit::Int(n) = &l.lit
                && n.base10_parse::<usize>().ok() == Some(0)
            {
                return Err(Error::new(
                    a.len.span(),
                    "an array of no elements carries nothing: remove the field",
                ));
            }
            let len = &a.len;
            Ok((p, quote!(#len)))
        }
        _ => Ok((single(ty).ok_or_else(refuse)?, quote!(0))),
    }
}

fn expand(input: &DeriveInput) -> Result<proc_macro2::TokenStream, Error> {
    let name = &input.ident;
    let is_c = input
        .attrs
        .iter()
        .any(|a| a.path().is_ident("repr") && a.parse_args::<syn::Ident>().is_ok_and(|i| i == "C"));
    if !is_c {
        return Err(Error::new(
            name.span(),
            "write #[repr(C)]: without it the order of the bytes is not fixed",
        ));
    }
    let fields = match &input.data {
        Data::Struct(s) => match &s.fields {
            Fields::Named(f) => &f.named,
            _ => return Err(Error::new(name.span(), "name the fields: a recording is read by name")),
        },
        _ => return Err(Error::new(name.span(), "only a struct can be a sample")),
    };
    let mut rows = Vec::new();
    let mut last: Option<(usize, String)> = None;
    for f in fields {
        let ident = f.ident.as_ref().ok_or_else(|| Error::new(f.span(), "name the field"))?;
        let (p, len) = field_type(&f.ty)?;
        if let Some((align, before)) = &last
            && p.align > *align
        {
            return Err(Error::new(
                f.span(),
                format!(
                    "`{ident}` needs alignment {} after `{before}` with {align}: order the fields by falling alignment, \
                     so that the bytes in memory are the CDR body",
                    p.align
                ),
            ));
        }
        last = Some((p.align, ident.to_string()));
        let mut unit = LitStr::new("", ident.span());
        for a in f.attrs.iter().filter(|a| a.path().is_ident("unit")) {
            unit = a.parse_args::<LitStr>()?;
        }
        let text = ident.to_string();
        let variant = syn::Ident::new(p.variant, ident.span());
        let names = names::of(f, p.is_integer())?;
        let about = doc::text(&f.attrs);
        rows.push(quote!(::stillpoint_samples::Field {
            name: #text,
            primitive: ::stillpoint_samples::Primitive::#variant,
            array: #len,
            unit: #unit,
            names: #names,
            about: #about,
        }));
    }
    if rows.is_empty() {
        return Err(Error::new(name.span(), "a sample needs at least one field"));
    }
    Ok(quote! {
        impl ::stillpoint_samples::Layout for #name {
            const FIELDS: &'static [::stillpoint_samples::Field] = &[#(#rows),*];
        }
        const _: () = assert!(
            ::stillpoint_samples::fields_size(<#name as ::stillpoint_samples::Layout>::FIELDS)
                == ::core::mem::size_of::<#name>(),
            "the struct has padding: end it with an explicit `reserved` array, so that every byte is written"
        );
    })
}
