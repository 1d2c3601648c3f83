//! The arguments of the macro.
//!
//! In: tokens. Out: the literal of the path with its place, the precisions, and the further functions of each surface. Never opens a file.

use rsm_core::compile::Parts;
use rsm_core::lower::Recursive;
use rsm_core::number::Precision;
use syn::parse::{Parse, ParseStream};
use syn::{Ident, LitBool, LitFloat, LitInt, LitStr, Token};

/// `"path"`, then `precision = "f64" | "f32" | "both"`, `gradient = true`, `inside = true`, `once = "current, ..."`, `recursive = "angle"` with the
/// numbers of [`SETTINGS`], in any order, each at most once.
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
        let mut recursive: Option<LitStr> = None;
        let mut settings: [Option<(Ident, f64)>; SETTINGS.len()] = Default::default();
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
                "recursive" if recursive.is_none() => {
                    input.parse::<Token![=]>()?;
                    recursive = Some(input.parse()?);
                }
                word => match SETTINGS.iter().position(|name| *name == word) {
                    Some(place) if settings[place].is_none() => {
                        input.parse::<Token![=]>()?;
                        settings[place] = Some((key, number(input)?));
                    }
                    Some(_) => return refuse("which is given twice"),
                    None if ["precision", "gradient", "inside", "once", "recursive"].contains(&word) => {
                        return refuse("which is given twice");
                    }
                    None => {
                        return refuse(
                            "accepted are `precision = \"...\"`, `gradient = true`, `inside = true`, `once = \"...\"` and `recursive = \"...\"`",
                        );
                    }
                },
            }
        }
        let (gradient, once) = (gradient.unwrap_or_default(), once.unwrap_or_default());
        let recursive = following(recursive.as_ref(), &settings)?.into_iter().collect();
        let parts = Parts { gradient, inside: inside.unwrap_or(!once.is_empty()), once, recursive };
        Ok(Arguments { path, precisions: precisions.unwrap_or_default(), parts })
    }
}

/// The numbers of a surface that follows measured responses, as the options of `rsm emit --recursive`.
const SETTINGS: [&str; 5] = ["noise", "forgetting", "gate", "limit", "start"];

/// A number with a point or without.
fn number(input: ParseStream<'_>) -> syn::Result<f64> {
    if input.peek(LitInt) { input.parse::<LitInt>()?.base10_parse() } else { input.parse::<LitFloat>()?.base10_parse() }
}

/// The surface that follows measured responses, with its settings. The defaults are those of `rsm emit`; the noise has none, since the macro reads no
/// figures of a fit.
fn following(
    surface: Option<&LitStr>,
    settings: &[Option<(Ident, f64)>; SETTINGS.len()],
) -> syn::Result<Option<(String, Recursive)>> {
    let Some(surface) = surface else {
        return match settings.iter().flatten().next() {
            Some((key, _)) => Err(syn::Error::new(
                key.span(),
                format!("found `{key}` without `recursive = \"...\"`, whose settings it gives"),
            )),
            None => Ok(None),
        };
    };
    let [noise, forgetting, gate, limit, start] = [0, 1, 2, 3, 4].map(|k| settings[k].as_ref().map(|(_, value)| *value));
    let Some(noise) = noise else {
        let what = "`recursive` needs `noise = ...`: the standard deviation of a measured response";
        return Err(syn::Error::new(surface.span(), what));
    };
    let usual = Recursive::new(noise);
    let limit = limit.unwrap_or(usual.limit);
    let settings = Recursive {
        forgetting: forgetting.unwrap_or(usual.forgetting),
        noise,
        gate: gate.unwrap_or(usual.gate),
        limit,
        start: start.unwrap_or(limit),
    };
    Ok(Some((surface.value(), settings)))
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
