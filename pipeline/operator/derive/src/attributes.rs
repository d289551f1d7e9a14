//! The attributes of a field: `#[param(...)]` and its doc comment.

use quote::ToTokens;
use syn::meta::ParseNestedMeta;
use syn::punctuated::Punctuated;
use syn::{Attribute, Error, Expr, ExprLit, Field, Lit, LitStr, Meta, Token, UnOp};

/// What a field says about itself.
#[derive(Default)]
pub struct Attributes {
    pub about: String,
    pub unit: Option<LitStr>,
    pub default: Option<String>,
    pub min: Option<String>,
    pub above: Option<String>,
    pub max: Option<String>,
    pub choices: Vec<LitStr>,
    pub names: Names,
    pub is_live: bool,
}

/// What a text names.
#[derive(Default)]
pub enum Names {
    #[default]
    Nothing,
    File,
    /// Files whose names fit a pattern.
    Files(LitStr),
}

impl Attributes {
    pub fn of(field: &Field) -> Result<Self, Error> {
        let mut found = Self { about: doc(&field.attrs), ..Self::default() };
        for attribute in field.attrs.iter().filter(|a| a.path().is_ident("param")) {
            attribute.parse_nested_meta(|meta| found.take(&meta))?;
        }
        if found.about.is_empty() {
            return Err(Error::new_spanned(
                field,
                "say in a doc comment what the parameter is for: schema and reference show it",
            ));
        }
        if found.min.is_some() && found.above.is_some() {
            return Err(Error::new_spanned(field, "give `min` or `above`, not both"));
        }
        Ok(found)
    }

    fn take(&mut self, meta: &ParseNestedMeta<'_>) -> Result<(), Error> {
        let text = || meta.value()?.parse::<Expr>().and_then(|e| as_text(&e));
        let key = meta.path.get_ident().map(ToString::to_string).unwrap_or_default();
        match key.as_str() {
            "unit" => self.unit = Some(meta.value()?.parse()?),
            "default" => self.default = Some(text()?),
            "min" => self.min = Some(text()?),
            "above" => self.above = Some(text()?),
            "max" => self.max = Some(text()?),
            "live" => self.is_live = true,
            "file" => self.names = Names::File,
            "files" => self.names = Names::Files(meta.value()?.parse()?),
            "choices" => {
                let content;
                syn::parenthesized!(content in meta.input);
                self.choices =
                    Punctuated::<LitStr, Token![,]>::parse_terminated(&content)?.into_iter().collect();
            }
            _ => {
                return Err(meta.error(
                    "write unit, default, min, above, max, choices(..), live, file or files = \"*\"",
                ));
            }
        }
        Ok(())
    }
}

/// A literal as a config would write it.
fn as_text(expr: &Expr) -> Result<String, Error> {
    match expr {
        Expr::Lit(ExprLit { lit, .. }) => match lit {
            Lit::Str(s) => Ok(s.value()),
            Lit::Int(i) => Ok(i.base10_digits().to_owned()),
            Lit::Float(f) => Ok(f.base10_digits().to_owned()),
            Lit::Bool(b) => Ok(b.value.to_string()),
            other => Err(Error::new_spanned(other, "write a text, a number, true or false")),
        },
        Expr::Unary(u) if matches!(u.op, UnOp::Neg(_)) => Ok(format!("-{}", as_text(&u.expr)?)),
        other => Err(Error::new_spanned(
            other.to_token_stream(),
            "write a literal: it is in the schema and the reference",
        )),
    }
}

/// A doc comment as one line.
fn doc(attributes: &[Attribute]) -> String {
    let mut lines = Vec::new();
    for attribute in attributes.iter().filter(|a| a.path().is_ident("doc")) {
        if let Meta::NameValue(pair) = &attribute.meta
            && let Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) = &pair.value
        {
            lines.push(text.value().trim().to_owned());
        }
    }
    lines.join(" ").trim().to_owned()
}
