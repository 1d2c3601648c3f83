//! Tests of the residual after the causes: is it noise, or structure without an explanation?
//!
//! In: a sample and its explanation. Out: a list of tests, each with the probability that chance gives as much, and the estimated noise. Replicates
//! give a lack-of-fit test. Without replicates, neighbours are compared: if a smooth part is missing, the residuals of near points are similar. The
//! null distribution is that of noise after the same projections, through its first three moments. Names no cause.

use super::explained::Explained;
use super::sample::Sample;
use crate::engine::columns::{Basis, dot};
use crate::engine::significance::{ln_p_of_squares, ln_upper_of_moments, lower_gamma, most_significant};
use rsm_fit::random::Random;
use rsm_fit::residual_sd_of;

/// A test for remaining structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Test {
    /// The comparison in words.
    pub what: String,
    /// ln of the probability that chance gives as much.
    pub ln_p: f64,
}

/// Draws for the moments of a quadratic form. They give its standard deviation to 4 %.
const DRAWS: usize = 300;

/// With more rows, the distances of all pairs cost too much; then one input at a time is compared.
const MOST_PAIRED: usize = 3000;

/// A column with fewer distinct values has levels; it is no axis for a curve.
const LEAST_DISTINCT: usize = 6;

/// The highest order of waves: sixty-four teeth or periods over the range of an input.
const HIGHEST_WAVE: usize = 64;

/// The highest order of polynomials that are tested on a residual.
const HIGHEST_BEND: usize = 5;

/// The largest number of monomials: all up to the fifth order of three inputs.
const MOST_BENDS: usize = 55;

/// A column whose independent part is below this per row is only rounding error.
const LEAST_NEW: f64 = 1e-6;

/// Pairs of near rows, as indices among the rows that count.
type Pairs = Vec<(usize, usize)>;

/// All tests.
pub(super) fn tests(sample: &Sample, found: &Explained) -> Vec<Test> {
    let space = found.space(sample);
    let kept = found.kept();
    let graphs = graphs(sample, &kept);
    // Here the coefficients of the file are free: their errors are tested elsewhere. Structure is what no choice of them removes.
    let columns = sample.terms.iter().chain(found.set.iter().flat_map(|it| &it.columns));
    let basis = Basis::of(&columns.map(|column| space.whitened(column)).collect::<Vec<_>>());
    let without = |mut values: Vec<f64>| {
        basis.project_out(&mut values);
        values
    };
    let left = without(space.whitened(&sample.residual()));
    let mut tests = Vec::new();
    if found.noise.rho.is_none() {
        tests.extend(replicates(sample, found, &kept, dot(&left, &left), basis.rank()));
    }
    // Correlated errors in the run order may be part of the surface, if the runs go through it in order. They count as noise only where no test
    // predicts them. Waves shorter than the distance of neighbours are visible only in the test of that wave.
    let predicted = |column: &[f64]| without(space.whitened(column));
    tests.extend(waves(sample, &kept, &left, basis.rank(), &predicted));
    tests.extend(bends(sample, &left, basis.rank(), &predicted));
    tests.extend(outliers_together(sample, found));
    let form =
        |pairs: &Pairs, u: &[f64]| pairs.iter().map(|(i, j)| u[*i] * u[*j]).sum::<f64>() / dot(u, u).max(f64::MIN_POSITIVE);
    let mut random = Random::new(0x1ef7);
    let mut drawn: Vec<Vec<f64>> = vec![Vec::with_capacity(DRAWS); graphs.len()];
    for _ in 0..DRAWS {
        let draw = without((0..kept.len()).map(|_| random.normal()).collect());
        for ((_, pairs), drawn) in graphs.iter().zip(&mut drawn) {
            drawn.push(form(pairs, &draw));
        }
    }
    for ((what, pairs), drawn) in graphs.into_iter().zip(drawn) {
        let mean = drawn.iter().sum::<f64>() / DRAWS as f64;
        let moment = |k: i32| drawn.iter().map(|q| (q - mean).powi(k)).sum::<f64>() / DRAWS as f64;
        let ln_p = ln_upper_of_moments(form(&pairs, &left), mean, moment(2), moment(3));
        tests.push(Test { what, ln_p });
    }
    tests
}

/// Waves of every order over each input and each further column: the most significant one, with Bonferroni's correction for all that were tried.
fn waves(sample: &Sample, kept: &[usize], left: &[f64], rank: usize, predicted: &dyn Fn(&[f64]) -> Vec<f64>) -> Option<Test> {
    let coded = (0..sample.inputs.len()).map(|input| (sample.inputs[input].name.clone(), sample.coded(input)));
    let extras = sample.extras.iter().filter(|it| !it.clock).filter_map(|it| Some((it.name.clone(), it.values.clone()?)));
    let mut tried = Vec::new();
    for (name, column) in coded.chain(extras) {
        let mut distinct: Vec<f64> = kept.iter().map(|row| column[*row]).collect();
        distinct.sort_by(f64::total_cmp);
        distinct.dedup();
        let (Some(low), Some(high)) = (distinct.first(), distinct.last()) else { continue };
        if distinct.len() < LEAST_DISTINCT {
            continue;
        }
        // A wave needs at least two values per period.
        for order in 1..=(distinct.len() / 2).min(HIGHEST_WAVE) {
            let turns = |x: f64| std::f64::consts::TAU * order as f64 * (x - low) / (high - low);
            let pair = [f64::cos, f64::sin].map(|of| predicted(&column.iter().map(|x| of(turns(*x))).collect::<Vec<_>>()));
            tried.extend(ln_p_of(left, rank, &pair).map(|ln_p| (ln_p, (order, name.clone()))));
        }
    }
    let (ln_p, (order, name)) = most_significant(tried, 1.0)?;
    Some(Test { what: format!("a wave of order {order} over the range of {name}"), ln_p })
}

/// Monomials of the inputs up to the second order, up to the third and so on: these are missing if the order of a surface is too low. The most
/// significant one, with Bonferroni's correction.
fn bends(sample: &Sample, left: &[f64], rank: usize, predicted: &dyn Fn(&[f64]) -> Vec<f64>) -> Option<Test> {
    let coded: Vec<Vec<f64>> = (0..sample.inputs.len()).map(|input| sample.coded(input)).collect();
    // The monomials of one degree, each with its last input, so that none occurs twice.
    let mut degree: Vec<(Vec<f64>, usize)> = vec![(vec![1.0; sample.rows()], 0)];
    let mut new: Vec<Vec<f64>> = Vec::new();
    let mut tried = Vec::new();
    for order in 1..=HIGHEST_BEND {
        let next = degree.iter().flat_map(|(values, from)| {
            let further = coded.iter().enumerate().skip(*from);
            further.map(move |(input, column)| (values.iter().zip(column).map(|(a, b)| a * b).collect(), input))
        });
        degree = next.collect();
        if new.len() + degree.len() > MOST_BENDS {
            break;
        }
        new.extend(degree.iter().map(|(column, _)| predicted(column)));
        tried.extend(ln_p_of(left, rank, &new).map(|ln_p| (ln_p, order)));
    }
    let (ln_p, order) = most_significant(tried, 1.0)?;
    Some(Test { what: format!("powers of the inputs up to the order {order}"), ln_p })
}

/// The F test of columns that are orthogonal to all known columns: ln of the probability that noise is predicted as well. `None` if the columns are
/// dependent, or too few rows are left.
fn ln_p_of(left: &[f64], rank: usize, columns: &[Vec<f64>]) -> Option<f64> {
    // A column that depends on the known ones leaves only rounding error.
    let length = (left.len() as f64).sqrt();
    let basis = Basis::of(columns.iter().filter(|it| dot(it, it).sqrt() > LEAST_NEW * length));
    let rest = left.len().checked_sub(rank + basis.rank()).filter(|rest| *rest > 0 && basis.rank() > 0)?;
    let explained = basis.projected_square(left);
    Some(ln_p_of_squares(explained, basis.rank() as f64, dot(left, left) - explained, rest as f64))
}

/// Whether outlying runs are neighbours with residuals of the same sign. Then the surface is wrong at that place, and these are not errors of single
/// runs. With n runs and k outliers at random, about k (k - 1)/2 * 4/n * 1/2 pairs are among each other's four nearest with the same sign; their
/// number has a Poisson distribution.
fn outliers_together(sample: &Sample, found: &Explained) -> Option<Test> {
    let (count, rows) = (found.outliers.len(), sample.rows());
    if count < 2 || !(12..=MOST_PAIRED).contains(&rows) {
        return None;
    }
    let coded: Vec<Vec<f64>> = (0..sample.inputs.len()).map(|input| sample.coded(input)).collect();
    let residual = |row: usize| sample.response[row] - found.fitted[row];
    let is_pair =
        |(i, j): &(usize, usize)| found.outliers.contains(i) && found.outliers.contains(j) && residual(*i) * residual(*j) > 0.0;
    let pairs = nearest(&coded, 4).iter().filter(|pair| is_pair(pair)).count();
    let mean = (count * (count - 1)) as f64 / rows as f64;
    // For a Poisson variable, P(N >= pairs) is the lower incomplete gamma function.
    let ln_p = if pairs == 0 { 0.0 } else { lower_gamma(pairs as f64, mean).max(1e-300).ln() };
    Some(Test { what: "outlying runs beside each other in the inputs".to_string(), ln_p })
}

/// Neighbours in all inputs together, and along each input and each further column alone.
fn graphs(sample: &Sample, kept: &[usize]) -> Vec<(String, Pairs)> {
    let rows = kept.len();
    let mut graphs = Vec::new();
    let near = ((rows as f64).sqrt() as usize).max(3);
    let coded: Vec<Vec<f64>> = (0..sample.inputs.len())
        .map(|input| {
            let column = sample.coded(input);
            kept.iter().map(|row| column[*row]).collect()
        })
        .collect();
    if coded.len() > 1 && rows <= MOST_PAIRED {
        // In a plane, four neighbours are one on each side. The square root of the number of rows detects slow curvature.
        for count in std::iter::once(4).chain((near > 6).then_some(near)) {
            if count < rows {
                graphs.push((format!("residuals of the {count} nearest points in the inputs"), nearest(&coded, count)));
            }
        }
    }
    let inputs = sample.inputs.iter().zip(&coded).map(|(input, column)| (input.name.clone(), column.clone()));
    let extras = sample.extras.iter().filter(|it| !it.clock).filter_map(|it| {
        let values = it.values.as_ref()?;
        Some((it.name.clone(), kept.iter().map(|row| values[*row]).collect::<Vec<f64>>()))
    });
    for (name, column) in inputs.chain(extras) {
        let mut distinct: Vec<u64> = column.iter().map(|x| (x + 0.0).to_bits()).collect();
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() >= LEAST_DISTINCT {
            graphs.push((format!("residuals of runs that are neighbours in {name}"), along(&column, near / 2)));
        }
    }
    graphs
}

/// Each point with its nearest neighbours; every pair once.
fn nearest(coded: &[Vec<f64>], count: usize) -> Pairs {
    let rows = coded.first().map_or(0, Vec::len);
    let mut pairs = Vec::new();
    for i in 0..rows {
        let square = |j: usize| coded.iter().map(|column| (column[i] - column[j]).powi(2)).sum::<f64>();
        let mut others: Vec<(f64, usize)> = (0..rows).filter(|j| *j != i).map(|j| (square(j), j)).collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        pairs.extend(others.iter().take(count).map(|(_, j)| (i.min(*j), i.max(*j))));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Each point with the following ones in the order of a column.
fn along(column: &[f64], reach: usize) -> Pairs {
    let mut order: Vec<usize> = (0..column.len()).collect();
    order.sort_by(|a, b| column[*a].total_cmp(&column[*b]).then(a.cmp(b)));
    let mut pairs = Vec::new();
    for (k, i) in order.iter().enumerate() {
        pairs.extend(order.iter().skip(k + 1).take(reach.max(1)).map(|j| (*i, *j)));
    }
    pairs
}

/// Groups of at least two rows with the same settings of all inputs, as indices among the rows that count.
fn groups(sample: &Sample, kept: &[usize]) -> Vec<Vec<usize>> {
    let mut groups: std::collections::BTreeMap<Vec<u64>, Vec<usize>> = std::collections::BTreeMap::new();
    for (place, row) in kept.iter().enumerate() {
        let key = sample.points.iter().map(|column| (column[*row] + 0.0).to_bits()).collect();
        groups.entry(key).or_default().push(place);
    }
    groups.into_values().collect()
}

/// Sum of squares within groups and its degrees of freedom.
fn pure_error(residual: &[f64], groups: &[Vec<usize>]) -> (f64, usize) {
    let mut square = 0.0;
    let mut freedom = 0;
    for group in groups {
        let mean = group.iter().map(|place| residual[*place]).sum::<f64>() / group.len() as f64;
        square += group.iter().map(|place| (residual[*place] - mean).powi(2)).sum::<f64>();
        freedom += group.len() - 1;
    }
    (square, freedom)
}

/// The residuals divided by their relative standard deviations.
fn with_uniform_noise(sample: &Sample, found: &Explained, kept: &[usize]) -> Vec<f64> {
    kept.iter().map(|row| (sample.response[*row] - found.fitted[*row]) / found.scale[*row]).collect()
}

/// The F test of lack of fit against pure error (Myers, Montgomery, Anderson-Cook, 2.7).
fn replicates(sample: &Sample, found: &Explained, kept: &[usize], square: f64, rank: usize) -> Option<Test> {
    let groups = groups(sample, kept);
    let (pure, freedom) = pure_error(&with_uniform_noise(sample, found, kept), &groups);
    let lack = groups.len().checked_sub(rank).filter(|lack| *lack > 0)?;
    if freedom < 2 || pure <= 0.0 {
        return None;
    }
    Some(Test {
        what: format!("lack of fit against the scatter of {freedom} replicates"),
        ln_p: ln_p_of_squares(square - pure, lack as f64, pure, freedom as f64),
    })
}

/// The noise of the response.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseFloor {
    /// Its standard deviation, averaged over the rows.
    pub sd: f64,
    /// Its source, in words.
    pub from: String,
}

/// With fewer degrees of freedom, a standard deviation is uncertain by more than a third.
const LEAST_FREEDOM: usize = 4;

/// The noise: from replicates, otherwise from neighbours, otherwise from the file's evidence, otherwise from the residual of the explanation.
pub(super) fn floor(sample: &Sample, found: &Explained) -> NoiseFloor {
    let kept = found.kept();
    let residual = with_uniform_noise(sample, found, &kept);
    let mean_scale = (kept.iter().map(|row| found.scale[*row].powi(2)).sum::<f64>() / kept.len().max(1) as f64).sqrt();
    let (pure, freedom) = pure_error(&residual, &groups(sample, &kept));
    if freedom >= LEAST_FREEDOM {
        return NoiseFloor {
            sd: mean_scale * (pure / freedom as f64).sqrt(),
            from: format!("{freedom} degrees of freedom of replicates"),
        };
    }
    // Half the mean square of differences of neighbours (Gasser, Sroka, Jennen-Steinmetz 1986, in its simplest form).
    if kept.len() >= 20 && kept.len() <= MOST_PAIRED {
        let coded: Vec<Vec<f64>> = (0..sample.inputs.len())
            .map(|input| {
                let column = sample.coded(input);
                kept.iter().map(|row| column[*row]).collect()
            })
            .collect();
        let pairs = nearest(&coded, 1);
        let square = pairs.iter().map(|(i, j)| (residual[*i] - residual[*j]).powi(2)).sum::<f64>() / (2 * pairs.len()) as f64;
        return NoiseFloor { sd: mean_scale * square.sqrt(), from: "differences of nearest neighbours".to_string() };
    }
    let of_file = residual_sd_of(&sample.surface).filter(|sd| *sd > 0.0);
    if let Some(sd) = of_file {
        return NoiseFloor { sd, from: "the model file's evidence".to_string() };
    }
    let unknowns: usize = found.set.iter().map(|it| it.columns.len()).sum();
    let freedom = kept.len().saturating_sub(unknowns).max(1);
    NoiseFloor {
        sd: mean_scale * (dot(&residual, &residual) / freedom as f64).sqrt(),
        from: "what the explanation leaves".to_string(),
    }
}
