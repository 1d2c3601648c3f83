//! Expressions of the numbers of an effect: its simpler forms, and the limits that its numbers have in a real machine.
//!
//! In: the file of an effect, numbers. Out: the parts of each form with their values; whether the numbers are inside of their limits.

use std::collections::HashMap;

use rsm_core::source::Faults;

use super::file::Effect;
use super::forms::{Form, FormKind};
use super::known::scratch;
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
        let mut scratch = scratch()?;
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

    /// Whether its file has limits for numbers in a real machine: `least` or `most`.
    #[must_use]
    pub fn has_limits(&self) -> bool {
        self.numbers.iter().any(|it| it.least.is_some() || it.most.is_some())
    }

    /// Whether numbers are possible in a real machine: none is outside of `least` and `most` in its file. A limit that needs a number which is not
    /// given does not count.
    ///
    /// ```
    /// use rsm_model::effects::Catalogue;
    ///
    /// let catalogue = Catalogue::shipped();
    /// let friction = catalogue.find("stribeck-friction").unwrap();
    /// let possible = |coulomb, at_rest| friction.are_possible(&[("coulomb", coulomb), ("static", at_rest)]);
    /// assert!(possible(0.1, 0.2) && possible(0.1, 0.1));
    /// // Friction that falls towards rest, and friction that vanishes at speed.
    /// assert!(!possible(0.2, 0.1) && !possible(0.01, 0.2));
    /// ```
    #[must_use]
    pub fn are_possible(&self, numbers: &[(&str, f64)]) -> bool {
        let Some(mut scratch) = Some(self).filter(|it| it.has_limits()).and_then(|_| scratch().ok()) else { return true };
        let known: HashMap<String, f64> = numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect();
        let mut limit = |law: &Option<Expression>| law.as_ref().and_then(|law| self.number(&mut scratch, law, &known).ok());
        self.numbers.iter().all(|it| {
            let Some(value) = known.get(&it.name) else { return true };
            limit(&it.least).is_none_or(|least| *value >= least) && limit(&it.most).is_none_or(|most| *value <= most)
        })
    }
}
