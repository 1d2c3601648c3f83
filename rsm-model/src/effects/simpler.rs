//! Simpler forms of an effect with given numbers.
//!
//! In: the forms of an effect, its numbers. Out: the parts of each form with their values. Compares nothing.

use std::collections::HashMap;

use rsm_core::source::{Faults, Source};

use super::file::Effect;
use super::forms::{Form, FormKind};
use crate::flat::{Flat, Options};
use crate::syntax::tree::Expression;

/// A simpler form with its values.
#[derive(Debug, Clone, PartialEq)]
pub struct SimplerForm {
    /// How it relates to the effect.
    pub is: FormKind,
    /// The effects that act together, each with the value of its first number.
    pub parts: Vec<(String, f64)>,
    /// Roles of the site with their values in this form.
    pub values: Vec<(String, f64)>,
}

impl Effect {
    /// Whether it has simpler forms.
    #[must_use]
    pub fn has_forms(&self) -> bool {
        !self.forms.is_empty()
    }

    /// The effects of all forms; an effect may come more than once.
    pub fn kinds_in_forms(&self) -> impl Iterator<Item = &str> {
        self.forms.iter().flat_map(|it| &it.sum).map(|it| it.0.as_str())
    }

    /// The simpler forms of the effect with these numbers, in the order of its file.
    ///
    /// ```
    /// use rsm_model::effects::{Catalogue, FormKind};
    ///
    /// let catalogue = Catalogue::shipped();
    /// let friction = catalogue.find("asymmetric-friction").unwrap();
    /// let forms = friction.forms(&[("forward", 30.0), ("backward", 20.0)])?;
    /// let alike = forms.iter().find(|it| it.is == FormKind::Alike).unwrap();
    /// assert_eq!(alike.parts, [("coulomb-friction".to_string(), 25.0), ("constant-load".to_string(), 5.0)]);
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    ///
    /// # Errors
    /// If an expression uses a name that is no given number, or has no finite value.
    pub fn forms(&self, numbers: &[(&str, f64)]) -> Result<Vec<SimplerForm>, Faults> {
        let mut scratch = Flat::read(&Source::new("", "model Scales\nend Scales;\n"), &Options::default())?;
        let known: HashMap<String, f64> = numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
        let holds = |it: &&Form| {
            it.given.iter().all(|name| known.contains_key(name)) && !it.omitted.iter().any(|name| known.contains_key(name))
        };
        let mut list = Vec::new();
        for form in self.forms.iter().filter(holds) {
            let mut evaluated = |laws: &[(String, Expression)]| -> Result<Vec<(String, f64)>, Faults> {
                laws.iter().map(|(name, law)| Ok((name.clone(), self.number(&mut scratch, law, &known)?))).collect()
            };
            list.push(SimplerForm { is: form.is, parts: evaluated(&form.sum)?, values: evaluated(&form.values)? });
        }
        Ok(list)
    }
}
