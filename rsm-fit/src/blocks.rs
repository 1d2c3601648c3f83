//! Blocks: rows that were measured together, such as those of one day, one batch or one engine.
//!
//! In: the columns that tell blocks apart, the cells of the rows to fit. Out: the contrasts of the blocks as further columns of the fit, and the
//! effect of each block with its standard error. The model has no input for them: its surface is the mean over the blocks. Each block has one effect,
//! whatever the number of its rows, and no product with an input.
//!
//! Source: Box, Hunter, Hunter 2005, Statistics for Experimenters, section 4.2; effect coding: Draper, Smith 1998, Applied Regression Analysis,
//! chapter 14.

use rsm_core::model::{Category, Input, Outside, Surface, Term};
use rsm_core::source::Faults;
use serde::Serialize;

use crate::dd::Dd;
use crate::design::BLOCK;
use crate::missing::is_missing;
use crate::qr::Growing;
use crate::records::Records;
use crate::spec::{CONTRAST, Specification};

/// The effect of one block.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BlockEffect {
    /// The cells of its rows; those of several columns are joined by ` / `.
    pub block: String,
    /// The number of fitted rows.
    pub rows: usize,
    /// Its mean response minus that of all blocks, at the same inputs. The effects add up to 0.
    pub effect: f64,
    /// The standard error of the effect; `None` if the coefficients have none.
    pub standard_error: Option<f64>,
}

/// The blocks of a response.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BlocksReport {
    /// The columns that tell them apart.
    pub columns: Vec<String>,
    /// The standard deviation of the effects: the error that a new block adds.
    pub sd: f64,
    /// Every block, in the order of the rows.
    pub effects: Vec<BlockEffect>,
}

/// What stands between the cells of several columns in the name of a block.
const JOINT: &str = " / ";

/// The most blocks: each is a column of the fit, in every row.
const MOST_BLOCKS: usize = 300;

/// The most blocks that are named in a sentence.
const MOST_NAMED: usize = 6;

impl BlocksReport {
    /// The effect of the block of a row; 0 for a block without fitted rows, and for rows of files that were read without blocks. `labels`: the
    /// columns of [`Records::labels`].
    pub(crate) fn effect_of(&self, labels: &[String], records: &Records, row: usize) -> f64 {
        let level = cells(&self.columns, labels, records, row).map(|cells| cells.join(JOINT));
        self.effects.iter().find(|one| Some(&one.block) == level.as_ref()).map_or(0.0, |one| one.effect)
    }

    /// The blocks with their effects, as a sentence.
    #[must_use]
    pub fn words(&self, unit: &str) -> String {
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let of_one = |one: &BlockEffect| {
            let error = one.standard_error.map_or(String::new(), |error| format!(" +- {error:.2e}"));
            format!("{} {:+.4e}{error}", one.block, one.effect)
        };
        let mut named: Vec<String> = self.effects.iter().take(MOST_NAMED).map(of_one).collect();
        if self.effects.len() > MOST_NAMED {
            named.push(format!("{} more", self.effects.len() - MOST_NAMED));
        }
        let columns = self.columns.join(JOINT);
        format!("{} of {columns}, effects{unit} with sd {:.4e}: {}", self.effects.len(), self.sd, named.join(", "))
    }
}

/// The blocks of the rows to fit.
pub(crate) struct Blocks {
    columns: Vec<String>,
    /// The cells of the blocks, in the order of their first rows, and the names of their contrasts.
    category: Category,
}

impl Blocks {
    /// The blocks of the rows to fit; `None` if the specification has none, or if all rows are in one block.
    ///
    /// # Errors
    /// A row without a block.
    pub(crate) fn of(specification: &Specification, fit: &Records) -> Result<Option<Self>, Faults> {
        let columns = specification.blocks.clone();
        let labels: Vec<String> = specification.labels().into_iter().map(str::to_string).collect();
        let mut levels: Vec<String> = Vec::new();
        let mut seen = std::collections::BTreeSet::new();
        for row in 0..if columns.is_empty() { 0 } else { fit.rows() } {
            let cells = cells(&columns, &labels, fit, row).unwrap_or_default();
            if let Some((name, _)) = columns.iter().zip(&cells).find(|(_, cell)| is_missing(cell)) {
                let what = format!("`blocks`: row {} of `data` has no cell in column `{name}`", row + 1);
                let help = "fill the cell, or leave such rows out with `missing = \"drop-row\"`";
                return Err(Faults::one(specification.fault("blocks", what).help(help)));
            }
            let level = cells.join(JOINT);
            if seen.insert(level.clone()) {
                levels.push(level);
            }
            if levels.len() > MOST_BLOCKS {
                let what = format!("`blocks`: column `{}` tells more than {MOST_BLOCKS} blocks apart", columns.join(JOINT));
                let help = "a block is a day, a batch or a test rig with many rows; for many small groups use `keep_together`";
                return Err(Faults::one(specification.fault("blocks", what).help(help)));
            }
        }
        let inputs = levels.iter().take(levels.len().saturating_sub(1)).map(|level| format!("{BLOCK}{level}")).collect();
        let category = Category { name: columns.join(JOINT), levels, inputs, additive: true };
        Ok((category.levels.len() > 1).then_some(Blocks { columns, category }))
    }

    /// The number of contrasts.
    pub(crate) fn width(&self) -> usize {
        self.category.inputs.len()
    }

    /// The values of the contrasts in some rows. A row of an unknown block, or of a file without blocks, has the mean of all blocks.
    pub(crate) fn contrasts(&self, specification: &Specification, records: &Records) -> Vec<Vec<f64>> {
        let labels: Vec<String> = specification.labels().into_iter().map(str::to_string).collect();
        // No level is empty: a row of the data without a block is refused.
        let level = |row: usize| cells(&self.columns, &labels, records, row).map_or(String::new(), |cells| cells.join(JOINT));
        let levels: Vec<String> = (0..records.rows()).map(level).collect();
        self.category.columns(levels.iter().map(String::as_str), 0.0)
    }

    /// The contrasts as inputs of a surface.
    pub(crate) fn inputs(&self) -> impl Iterator<Item = Input> {
        let input =
            |name: &String| Input { name: name.clone(), unit: "1".to_string(), range: CONTRAST, outside: Outside::Clamp };
        self.category.inputs.iter().map(input)
    }

    /// The surface with the contrasts behind its own inputs.
    pub(crate) fn with(&self, surface: &Surface) -> Surface {
        let mut with = surface.clone();
        with.inputs.extend(self.category.inputs.iter().cloned());
        with.categories.push(self.category.clone());
        with
    }

    /// Given terms of a surface with `inputs` inputs of its own, and each contrast.
    pub(crate) fn with_terms(&self, terms: &[Vec<u32>], inputs: usize) -> Vec<Vec<u32>> {
        let mut all: Vec<Vec<u32>> = terms.to_vec();
        for powers in &mut all {
            powers.splice(inputs..inputs, std::iter::repeat_n(0, self.width()));
        }
        let width = all.first().map_or(inputs + self.width(), Vec::len);
        all.extend((0..self.width()).map(|k| (0..width).map(|place| u32::from(place == inputs + k)).collect()));
        all
    }

    /// The powers of a term without the contrasts; `None` for the term of a contrast.
    pub(crate) fn without(&self, powers: &[u32], inputs: usize) -> Option<Vec<u32>> {
        let own = powers.get(inputs..inputs + self.width())?;
        let is_own = own.iter().all(|power| *power == 0);
        is_own.then(|| [&powers[..inputs], &powers[inputs + self.width()..]].concat())
    }

    /// The effects of the fitted terms. `growing`: their solution, if it has standard errors, with the residual mean square; `contrasts`: those of
    /// the fitted rows.
    pub(crate) fn report(
        &self,
        terms: &[Term],
        inputs: usize,
        solution: Option<(&Growing, f64)>,
        contrasts: &[Vec<f64>],
    ) -> BlocksReport {
        let of_contrast = |k: usize| terms.iter().position(|term| term.powers[inputs + k] == 1);
        let places: Vec<Option<usize>> = (0..self.width()).map(of_contrast).collect();
        let rows = contrasts.first().map_or(0, Vec::len);
        let of_one = |level: &String| {
            let own = self.category.contrasts(level).unwrap_or_default();
            let pairs = || own.iter().zip(&places).filter_map(|(value, place)| Some((*value, (*place)?)));
            let effect = pairs().map(|(value, place)| value * terms[place].coefficient).sum::<f64>() + 0.0;
            let error = |(growing, mean_square): (&Growing, f64)| {
                let mut row = vec![Dd::ZERO; terms.len()];
                pairs().for_each(|(value, place)| row[place] = Dd::from(value));
                (mean_square * growing.leverage(&row).to_f64()).sqrt()
            };
            let is_own = |row: &usize| contrasts.iter().zip(&own).all(|(column, value)| column[*row] == *value);
            BlockEffect {
                block: level.clone(),
                rows: (0..rows).filter(is_own).count(),
                effect,
                standard_error: solution.map(error),
            }
        };
        let effects: Vec<BlockEffect> = self.category.levels.iter().map(of_one).collect();
        let square: f64 = effects.iter().map(|one| one.effect * one.effect).sum();
        BlocksReport { columns: self.columns.clone(), sd: (square / self.width() as f64).sqrt(), effects }
    }
}

/// The cells of a row in the columns of the blocks; `None` for rows of files that were read without them.
fn cells(columns: &[String], labels: &[String], records: &Records, row: usize) -> Option<Vec<String>> {
    let place = |column: &String| labels.iter().position(|label| label == column);
    let cell = |column: &String| records.labels.get(place(column)?)?.get(row).cloned();
    columns.iter().map(cell).collect()
}
