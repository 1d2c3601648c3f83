//! The arguments of the macro.
//!
//! In: tokens. Out: the literal of the path with its place, the precisions, and the further functions of each surface. Never opens a file.

use rsm_core::compile::Parts;
use rsm_core::number::Precision;
use syn::parse::{Parse, ParseStream};
use syn::{Ident, LitBool, LitStr, Token};

/// `"path"`, then `precision = "f64" | "f32" | "both"`, `gradient = true`, `inside = true` and `once = "current, ..."`, in any order, each at most
/// once.
pub(crate) struct Arguments {
    pub(crate) path: LitStr,
    /// Empty: every precision that can represent the model.
    pub(crate) precisions: Vec<Precision>,
    /// The further functions of each surface.
    pub(crate) parts: Parts,
}

impl Parse for Arguments {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let path = input.parse()?;
        let (mut precisions, mut gradient, mut inside, mut once) = (None, None, None, None);
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
                "inside" if inside.is_none() => {
                    input.parse::<Token![=]>()?;
                    inside = Some(input.parse::<LitBool>()?.value);
                }
                "once" if once.is_none() => {
                    input.parse::<Token![=]>()?;
                    let names = input.parse::<LitStr>()?.value();
                    once = Some(names.split(',').map(|name| name.trim().to_string()).collect::<Vec<_>>());
                }
                "precision" | "gradient" | "inside" | "once" => return refuse("which is given twice"),
                _ => {
                    return refuse(
                        "accepted are `precision = \"...\"`, `gradient = true`, `inside = true` and `once = \"...\"`",
                    );
                }
            }
        }
        let (gradient, once) = (gradient.unwrap_or_default(), once.unwrap_or_default());
        let parts = Parts { gradient, inside: inside.unwrap_or(!once.is_empty()), once, ..Parts::default() };
        Ok(Arguments { path, precisions: precisions.unwrap_or_default(), parts })
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
