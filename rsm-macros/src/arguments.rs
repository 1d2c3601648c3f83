//! The arguments of the macro.
//!
//! In: tokens. Out: the literal of the path, with its place, the precisions, and whether gradients are wanted. Never opens a file.

use rsm_core::number::Precision;
use syn::parse::{Parse, ParseStream};
use syn::{Ident, LitBool, LitStr, Token};

/// `"path"`, then `precision = "f64" | "f32" | "both"` and `gradient = true`, in any order, each at most once.
pub(crate) struct Arguments {
    pub(crate) path: LitStr,
    /// Empty: every precision that can hold the model.
    pub(crate) precisions: Vec<Precision>,
    /// Whether each surface is to have its gradient.
    pub(crate) gradient: bool,
}

impl Parse for Arguments {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let path = input.parse()?;
        let (mut precisions, mut gradient) = (None, None);
        while input.parse::<Option<Token![,]>>()?.is_some() && !input.is_empty() {
            let key: Ident = input.parse()?;
            let refuse = |what: &str| Err(syn::Error::new(key.span(), format!("found `{key}`, {what}")));
            match key.to_string().as_str() {
                "precision" if precisions.is_none() => {
                    input.parse::<Token![=]>()?;
                    precisions = Some(self::precisions(&input.parse()?)?);
                }
                "gradient" if gradient.is_none() => {
                    input.parse::<Token![=]>()?;
                    gradient = Some(input.parse::<LitBool>()?.value);
                }
                "precision" | "gradient" => return refuse("which is given twice"),
                _ => return refuse("accepted are `precision = \"...\"` and `gradient = true`"),
            }
        }
        Ok(Arguments { path, precisions: precisions.unwrap_or_default(), gradient: gradient.unwrap_or_default() })
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
