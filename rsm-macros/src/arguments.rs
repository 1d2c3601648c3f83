//! The arguments of the macro.
//!
//! In: tokens. Out: the literal of the path, with its place, and the precisions. Never opens a file.

use rsm_core::number::Precision;
use syn::parse::{Parse, ParseStream};
use syn::{Ident, LitStr, Token};

/// `"path"` or `"path", precision = "f64" | "f32" | "both"`.
pub(crate) struct Arguments {
    pub(crate) path: LitStr,
    /// Empty: every precision that can hold the model.
    pub(crate) precisions: Vec<Precision>,
}

impl Parse for Arguments {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let path = input.parse()?;
        let mut precisions = Vec::new();
        if input.parse::<Option<Token![,]>>()?.is_some() && !input.is_empty() {
            let key: Ident = input.parse()?;
            if key != "precision" {
                return Err(syn::Error::new(key.span(), format!("found `{key}`, accepted is `precision = \"...\"`")));
            }
            input.parse::<Token![=]>()?;
            precisions = self::precisions(&input.parse()?)?;
            input.parse::<Option<Token![,]>>()?;
        }
        Ok(Arguments { path, precisions })
    }
}

fn precisions(word: &LitStr) -> syn::Result<Vec<Precision>> {
    let value = word.value();
    if value == "both" {
        return Ok(Precision::ALL.to_vec());
    }
    match Precision::ALL.into_iter().find(|precision| precision.name() == value) {
        Some(precision) => Ok(vec![precision]),
        None => {
            Err(syn::Error::new(word.span(), format!("found precision \"{value}\", accepted are \"f64\", \"f32\", \"both\"")))
        }
    }
}
