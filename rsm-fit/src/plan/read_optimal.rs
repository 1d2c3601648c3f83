//! Reads the requirements on an optimal design, the terms of a model, and the generators of a fraction.
//!
//! In: the keys of a design specification, and the files that they name. Out: an [`Optimum`], terms, a [`Fraction`], conditions, and every fault.

use std::path::Path;

use rsm_core::check::Checked;
use rsm_core::model::{Coding, Surface};
use rsm_core::source::{Collector, Faults, Source};
use rsm_core::toml_reader::{TableReader, Value};

use super::design::{Condition, Criterion, Factor, MOST_RUNS, Optimum};
use super::fraction::Fraction;
use super::rules::MOST_ORDER;
use crate::design::{count_of_terms, monomials_up_to};
use crate::spec::{MOST_TERMS, Method, Specification};
use crate::table::{Table, Wanted};
use crate::units::Conversion;

/// The data to which the keys refer.
pub(super) struct Around<'a> {
    pub factors: &'a [Factor],
    pub folder: &'a Path,
}

impl Around<'_> {
    fn factor(&self, who: &str, name: &str) -> Result<usize, String> {
        let known = || self.factors.iter().map(|factor| format!("`{}`", factor.name)).collect::<Vec<_>>().join(", ");
        let found = self.factors.iter().position(|factor| factor.name == name);
        found.ok_or_else(|| format!("{who}: there is no factor `{name}`, the factors are {}", known()))
    }

    fn read(&self, file: &str) -> Result<Source, Faults> {
        Source::read(&self.folder.join(file))
    }
}

/// Reports the faults of another file unchanged.
fn tell(other: &Faults, faults: &mut Collector) {
    for fault in other.list() {
        faults.push(fault.clone());
    }
}

/// Reads `order`, `terms` or `terms_of`; second order if there is none of them.
pub(super) fn read_terms(top: &mut TableReader<'_>, around: &Around<'_>, faults: &mut Collector) -> Option<Vec<Vec<u32>>> {
    let (order, terms, of) = (top.optional("order"), top.optional("terms"), top.optional("terms_of"));
    if [order, terms, of].iter().flatten().count() > 1 {
        faults.push(top.fault(top.key_span("terms_of"), "found several of `order`, `terms` and `terms_of`, expected one"));
        return None;
    }
    let found = match (order, terms, of) {
        (_, Some(value), _) => read_powers(value, top, around, faults)?,
        (_, _, Some(value)) => {
            let found = read_file(value, "terms_of", top, around, faults)?;
            let powers = found.terms(around);
            powers.map_err(|reason| faults.push(top.fault(value.span(), format!("`terms_of`: {reason}")))).ok()?
        }
        (order, ..) => {
            let order = order.map_or(Some(2), |value| top.whole("`order`", value, 1, i64::from(MOST_ORDER), faults))? as u32;
            // Check their number before they are created: 16 factors and order 8 have 735,471.
            let count = count_of_terms(around.factors.len(), order);
            if count > MOST_TERMS {
                let what = format!("the model has {count} terms, at most {MOST_TERMS} are accepted");
                faults.push(top.fault(top.key_span("order"), what));
                return None;
            }
            monomials_up_to(around.factors.len(), order)
        }
    };
    Some(found)
}

fn read_powers(value: Value<'_>, top: &TableReader<'_>, around: &Around<'_>, faults: &mut Collector) -> Option<Vec<Vec<u32>>> {
    let mut terms: Vec<Vec<u32>> = Vec::new();
    let items = top.array("`terms`", value, faults)?;
    for (k, item) in items.iter().enumerate() {
        let who = format!("`terms`: term {}", k + 1);
        let numbers = top.array(&who, item, faults)?;
        let powers: Vec<Option<i64>> =
            numbers.iter().map(|number| top.whole(&who, number, 0, i64::from(MOST_ORDER), faults)).collect();
        let powers: Vec<u32> = powers.into_iter().map(|power| power.map(|power| power as u32)).collect::<Option<_>>()?;
        if powers.len() != around.factors.len() {
            let what =
                format!("{who}: found {} powers, expected one for each of {} factors", powers.len(), around.factors.len());
            faults.push(top.fault(item.span(), what));
            return None;
        }
        if terms.contains(&powers) {
            faults.push(top.fault(item.span(), format!("{who} occurs twice")));
            return None;
        }
        terms.push(powers);
    }
    if terms.is_empty() || terms.len() > MOST_TERMS {
        faults.push(top.fault(value.span(), format!("`terms`: found {}, expected 1 to {MOST_TERMS}", terms.len())));
        return None;
    }
    Some(terms)
}

/// A surface of a model file, or a response of a fit specification.
enum File {
    Surface(Box<(Checked, usize)>),
    Response(Box<Specification>, usize),
}

/// `{ file = "motor.toml", surface = "angle" }`; the name may be omitted if there is only one.
fn read_file(value: Value<'_>, key: &str, top: &TableReader<'_>, around: &Around<'_>, faults: &mut Collector) -> Option<File> {
    let mut reader = TableReader::of(top.source(), value, format!("`{key}`"), faults)?;
    let (file, name) = (reader.text("file", faults), reader.optional_text("surface", faults));
    reader.finish(faults);
    let file = file?;
    let source = around.read(&file).map_err(|other| tell(&other, faults)).ok()?;
    let is_fit = source.text().lines().any(|line| line.trim_start().starts_with("[responses"));
    let pick = |names: Vec<String>, faults: &mut Collector| {
        let found = match &name {
            Some(name) => names.iter().position(|known| known == name),
            None => (names.len() == 1).then_some(0),
        };
        if found.is_none() {
            let wanted = name.as_ref().map_or("no `surface`".to_string(), |name| format!("`{name}`"));
            let what = format!("`{key}`: found {wanted}, expected one of {}", names.join(", "));
            faults.push(top.fault(value.span(), what));
        }
        found
    };
    if is_fit {
        let folder = around.folder.join(&file).parent().map(Path::to_path_buf).unwrap_or_default();
        let specification = Specification::from_source(source, folder).map_err(|other| tell(&other, faults)).ok()?;
        let names = specification.responses.iter().map(|response| response.surface.name.clone()).collect();
        let place = pick(names, faults)?;
        return Some(File::Response(Box::new(specification), place));
    }
    let checked = Checked::read(&source).map_err(|other| tell(&other, faults)).ok()?;
    let names = checked.model().surfaces.iter().map(|surface| surface.name.clone()).collect();
    let place = pick(names, faults)?;
    Some(File::Surface(Box::new((checked, place))))
}

impl File {
    fn surface(&self) -> &Surface {
        match self {
            File::Surface(found) => &found.0.model().surfaces[found.1],
            File::Response(specification, place) => &specification.responses[*place].surface,
        }
    }

    /// The terms, their powers in the order of the factors.
    fn terms(&self, around: &Around<'_>) -> Result<Vec<Vec<u32>>, String> {
        let surface = self.surface();
        let inputs = &surface.inputs;
        if !(surface.knots.is_empty() && surface.sigmoids.is_empty() && surface.waves.is_empty()) {
            return Err("the surface has hinges, sigmoids or waves; an optimal design is for powers only".to_string());
        }
        let is_spline = match self {
            File::Surface(_) => surface.spline.is_some(),
            File::Response(specification, place) => specification.responses[*place].spline.is_some(),
        };
        if is_spline {
            return Err("the surface is a spline; an optimal design is for powers only, and design = \"latin-hypercube\" fills the cells of a spline".to_string());
        }
        let places: Vec<usize> = inputs.iter().map(|name| around.factor("`terms_of`", name)).collect::<Result<_, _>>()?;
        let own = match self {
            File::Surface(_) => surface.terms.iter().map(|term| term.powers.clone()).collect(),
            File::Response(specification, place) => match &specification.responses[*place].method {
                Method::Fixed(terms) => terms.clone(),
                Method::FixedOrder(order) | Method::Ladder { max_order: order, .. } => monomials_up_to(inputs.len(), *order),
                Method::Search(search) => monomials_up_to(inputs.len(), search.max_order),
            },
        };
        let spread = |powers: &Vec<u32>| {
            let mut all = vec![0; around.factors.len()];
            places.iter().zip(powers).for_each(|(place, power)| all[*place] = *power);
            all
        };
        Ok(own.iter().map(spread).collect())
    }

    /// The support of a surface as conditions on the factors, in their units.
    fn support(&self, around: &Around<'_>) -> Result<Vec<Condition>, String> {
        let File::Surface(found) = self else {
            return Err("found a fit specification, expected a model file".to_string());
        };
        let (model, surface) = (found.0.model(), self.surface());
        if surface.support.is_empty() {
            return Err(format!("the surface `{}` has no `support`", surface.name));
        }
        if !surface.symmetry.is_empty() || !surface.reciprocal.is_empty() {
            return Err("the support of a surface with `symmetry` or `reciprocal` is not a set of half-spaces of the factors"
                .to_string());
        }
        let mut conditions = vec![
            Condition { weights: vec![0.0; around.factors.len()], at_most: Some(0.0), at_least: None };
            surface.support.len()
        ];
        for (k, name) in surface.inputs.iter().enumerate() {
            let place = around.factor("`support_of`", name)?;
            let input = model.input(name).ok_or_else(|| format!("the model has no input `{name}`"))?;
            let conversion = Conversion::between(&around.factors[place].unit, &input.unit)?;
            // The conversion is a + b xi; the coded variable (a + b xi - mid)/half.
            let offset = conversion.apply(0.0);
            let slope = conversion.apply(1.0) - offset;
            let [low, high] = input.range;
            let (mid, half) = match surface.coding {
                Coding::Range => (0.5 * (low + high), 0.5 * (high - low)),
                Coding::None => (0.0, 1.0),
            };
            for (condition, space) in conditions.iter_mut().zip(&surface.support) {
                condition.weights[place] = space.normal[k] * slope / half;
                let moved = condition.at_most.unwrap_or(0.0) - space.normal[k] * (offset - mid) / half;
                condition.at_most = Some(moved);
            }
        }
        for (condition, space) in conditions.iter_mut().zip(&surface.support) {
            condition.at_most = condition.at_most.map(|moved| moved + space.bound);
        }
        Ok(conditions)
    }
}

/// `support_of`.
pub(super) fn read_support(top: &mut TableReader<'_>, around: &Around<'_>, faults: &mut Collector) -> Option<Vec<Condition>> {
    let Some(value) = top.optional("support_of") else { return Some(Vec::new()) };
    let found = read_file(value, "support_of", top, around, faults)?;
    found.support(around).map_err(|reason| faults.push(top.fault(value.span(), format!("`support_of`: {reason}")))).ok()
}

/// The keys of an optimal design, except `runs`.
pub(super) fn read_optimum(
    top: &mut TableReader<'_>,
    runs: usize,
    criterion: Criterion,
    around: &Around<'_>,
    faults: &mut Collector,
) -> Option<Optimum> {
    let restarts = match top.optional("restarts") {
        Some(value) => Some(top.whole("`restarts`", value, 1, 10_000, faults)? as usize),
        None => None,
    };
    let mut block_sizes = Vec::new();
    if let Some(value) = top.optional("block_sizes") {
        for item in top.array("`block_sizes`", value, faults)? {
            block_sizes.push(top.whole("`block_sizes`", item, 1, MOST_RUNS as i64, faults)? as usize);
        }
        let sum: usize = block_sizes.iter().sum();
        if sum != runs {
            faults.push(top.fault(value.span(), format!("`block_sizes`: their sum is {sum} runs, but `runs` is {runs}")));
        }
    }
    let mut mandatory = Vec::new();
    if let Some(value) = top.optional("mandatory") {
        for (k, item) in top.array("`mandatory`", value, faults)?.into_iter().enumerate() {
            let who = format!("`mandatory`: point {}", k + 1);
            let reader = TableReader::of(top.source(), item, who.clone(), faults)?;
            let mut point = vec![None; around.factors.len()];
            for (name, place, value) in reader.entries() {
                let setting = reader.number(&format!("`{name}`"), value, faults)?;
                match around.factor(&who, name) {
                    Ok(k) => point[k] = Some(setting),
                    Err(reason) => faults.push(top.fault(place, reason)),
                }
            }
            if let Some(k) = point.iter().position(Option::is_none) {
                faults.push(top.fault(item.span(), format!("{who}: `{}` is missing", around.factors[k].name)));
            }
            mandatory.push(point.into_iter().flatten().collect());
        }
        if mandatory.len() > runs {
            let what = format!("`mandatory`: found {} points, but `runs` is {runs}", mandatory.len());
            faults.push(top.fault(value.span(), what));
        }
    }
    let candidates = match top.optional_text("candidates", faults) {
        Some(file) => Some(read_points(&around.folder.join(file), around.factors).map_err(|other| tell(&other, faults)).ok()?),
        None => None,
    };
    Some(Optimum { criterion, runs, block_sizes, mandatory, candidates, restarts })
}

/// The settings of the factors in a table, one point for each row, in the units of the factors.
pub(super) fn read_points(path: &Path, factors: &[Factor]) -> Result<Vec<Vec<f64>>, Faults> {
    let names = factors.iter().map(|factor| factor.name.clone()).collect();
    let table = Table::read(&Source::read(path)?, &Wanted { numbers: names, ..Wanted::default() })?;
    let mut faults = Collector::new();
    let mut columns = Vec::new();
    for factor in factors {
        // A table of candidates may omit units; they are then those of the factors.
        match table.values_in(&factor.name, Some(&factor.unit)) {
            Ok((values, _)) => columns.push(values),
            Err(fault) => faults.push(fault),
        }
    }
    let rows = table.rows();
    let point = |row: usize| columns.iter().map(|column| column[row]).collect();
    let is_whole = columns.len() == factors.len();
    faults.finish(Some(if is_whole { (0..rows).map(point).collect() } else { Vec::new() }))
}

/// `generators = { d = "a*b*c", e = "-a*b" }`, or the minimum aberration fraction with this many runs.
pub(super) fn read_fraction(
    top: &mut TableReader<'_>,
    runs: Option<usize>,
    around: &Around<'_>,
    faults: &mut Collector,
) -> Option<Fraction> {
    let count = around.factors.len();
    let Some(value) = top.optional("generators") else {
        let Some(runs) = runs else {
            let what = "`generators` or `runs` is missing: \"fractional-factorial\" needs one of them";
            faults.push(top.fault(top.key_span("design"), what));
            return None;
        };
        let base = runs.ilog2() as usize;
        let found = (runs.is_power_of_two() && base <= count).then(|| Fraction::least_aberration(count, base)).flatten();
        if found.is_none() {
            let least = (1..=count).find(|base| (1usize << base) > count).unwrap_or(count);
            let sizes: Vec<String> = (least..=count).map(|base| (1usize << base).to_string()).collect();
            let what = format!("`runs`: no fraction of the two-level factorial of {count} factors has {runs} runs");
            faults.push(
                top.fault(top.key_span("runs"), what)
                    .help(format!("fractions have {} runs; \"optimal\" has any number", sizes.join(", "))),
            );
        }
        return found;
    };
    if runs.is_some() {
        let what = "`runs`: not accepted with `generators`, which give the number of runs";
        faults.push(top.fault(top.key_span("runs"), what));
        return None;
    }
    let reader = TableReader::of(top.source(), value, "`generators`", faults)?;
    let entries: Vec<_> = reader.entries().collect();
    let mut generators = Vec::new();
    for (name, place, value) in &entries {
        let Ok(factor) = around.factor("`generators`", name).map_err(|reason| faults.push(top.fault(place.clone(), reason)))
        else {
            continue;
        };
        let Some(text) = value.get_ref().as_str() else {
            faults
                .push(reader.fault(value.span(), format!("`{name}`: expected a product of factors, as \"a*b*c\" or \"-a*b\"")));
            continue;
        };
        let (text, is_negative) = match text.trim().strip_prefix('-') {
            Some(rest) => (rest, true),
            None => (text.trim(), false),
        };
        let mut set = 0u32;
        for part in text.split('*').map(str::trim) {
            match around.factor(&format!("`generators`: `{name}`"), part) {
                Ok(k) if entries.iter().any(|(other, ..)| *other == part) || k == factor => {
                    let what = format!("`{name}`: `{part}` has a generator itself; write products of the other factors");
                    faults.push(reader.fault(value.span(), what));
                }
                Ok(k) => set ^= 1 << k,
                Err(reason) => faults.push(top.fault(value.span(), reason)),
            }
        }
        generators.push((factor, (set, is_negative)));
    }
    generators.sort_unstable();
    Some(Fraction { factors: count, generators })
}
