//! The options of a surface that follows measured responses, for `rsm emit --recursive` and `rsm track`.

use clap::Args;
use rsm_core::check::Checked;
use rsm_core::lower::Recursive;
use rsm_fit::track::Track;

use crate::outcome::Refusal;

#[derive(Args, Default)]
pub struct Following {
    /// The surface that follows measured responses; optional if the model has only one
    #[arg(long, value_name = "NAME")]
    pub surface: Option<String>,
    /// The weight of a row fades by this factor with each later row: 0.999 is a memory of about 1000 rows, 1 forgets nothing [default: 0.999]
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    forgetting: Option<f64>,
    /// The standard deviation of the noise of a measured response, in its unit [default: `residual_sd` of the surface in the model file]
    #[arg(long, value_name = "SD", allow_negative_numbers = true)]
    noise: Option<f64>,
    /// Freeze a row if the error of its prediction is above this number of standard deviations [default: 5]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    gate: Option<f64>,
    /// The largest standard deviation of a coefficient, in the unit of the response [default: the noise]
    #[arg(long, value_name = "SD", allow_negative_numbers = true)]
    limit: Option<f64>,
    /// The standard deviation of the coefficients at the start, at most the limit [default: the limit]
    #[arg(long, value_name = "SD", allow_negative_numbers = true)]
    start: Option<f64>,
}

impl Following {
    /// The first of these options that is given.
    pub fn given(&self) -> Option<&'static str> {
        let numbers = [
            ("--forgetting", self.forgetting),
            ("--noise", self.noise),
            ("--gate", self.gate),
            ("--limit", self.limit),
            ("--start", self.start),
        ];
        let number = numbers.into_iter().find(|(_, value)| value.is_some()).map(|(name, _)| name);
        self.surface.as_ref().map(|_| "--surface").or(number)
    }

    /// The surface, by its index, and the settings.
    pub fn settings(&self, checked: &Checked) -> Result<(usize, Recursive), Refusal> {
        let surface = super::surface_index(checked, self.surface.as_deref())?;
        let noise = self.noise.or_else(|| Track::noise_of_file(checked, surface)).ok_or_else(|| {
            let name = &checked.model().surfaces[surface].name;
            Refusal::new(format!(
                "{}: surface `{name}`: found no `residual_sd` in its evidence\n  help: give the standard deviation of the noise with --noise",
                checked.file()
            ))
        })?;
        let usual = Recursive::new(noise);
        let limit = self.limit.unwrap_or(usual.limit);
        let settings = Recursive {
            forgetting: self.forgetting.unwrap_or(usual.forgetting),
            noise,
            gate: self.gate.unwrap_or(usual.gate),
            limit,
            start: self.start.unwrap_or(limit),
        };
        let given = &checked.model().surfaces[surface];
        match settings.refusal(given) {
            Some(why) => Err(Refusal::new(format!("{}: surface `{}` cannot be updated: {why}", checked.file(), given.name))),
            None => Ok((surface, settings)),
        }
    }
}
