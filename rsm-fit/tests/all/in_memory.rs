//! Fits of rows in memory: the same bits as for the same rows in files; faults as text.

use nalgebra::{DMatrix, DVector};
use rsm_core::model::{Evidence, Model, Symmetry};
use rsm_core::model_file;
use rsm_core::source::Source;
use rsm_fit::fit::fit;
use rsm_fit::random::Random;
use rsm_fit::{Constraint, Fit, Input, Outcome, Response, Select, Specification, Verdict};

/// A hundred points, three responses, a weight and a group for each; the last twenty rows are in a separate file.
struct Rows {
    a: Vec<f64>,
    b: Vec<f64>,
    responses: [Vec<f64>; 3],
    weights: Vec<f64>,
    groups: Vec<usize>,
}

fn rows(count: usize, seed: u64) -> Rows {
    let mut random = Random::new(seed);
    let mut rows = Rows { a: vec![], b: vec![], responses: [vec![], vec![], vec![]], weights: vec![], groups: vec![] };
    for row in 0..count {
        let (a, b) = (random.share() * 4.0 - 2.0, random.share() * 10.0 + 5.0);
        let noise = random.share() - 0.5;
        rows.a.push(a);
        rows.b.push(b);
        rows.responses[0].push(3.0 + 2.0 * a - 0.3 * b + a * b + 0.1 * noise);
        rows.responses[1].push(a * a * (1.0 + b) + 0.1 * noise);
        rows.responses[2].push(10.0 / b + 0.01 * noise);
        rows.weights.push(1.0 + random.share());
        rows.groups.push(row / 5);
    }
    rows
}

const SPECIFICATION: &str = r#"
format = 1
model = "bench"
data = ["data.csv"]
validate = { share = 0.25, seed = 3, keep_together = ["group"] }
test = ["test.csv"]
[inputs.a]
unit = "m"
range = [-2.5, 2.5]
[inputs.b]
unit = "s"
outside = "extrapolate"
[responses.plain]
unit = "N"
inputs = ["a", "b"]
weights = "weight"
output_range = [-40.0, 40.0]
support = { from = "data", margin = 0.05 }
select = { method = "ladder", max_order = 3, confidence = 99.0 }
[responses.even]
unit = "N"
inputs = ["b", "a"]
weights = { standard_error = "weight" }
symmetry = { a = "even" }
constraints = [{ kind = "bounds", min = -1.0 }]
select = { method = "fixed", order = 3 }
[responses.inverse]
unit = "N"
inputs = ["b"]
reciprocal = ["b"]
terms = [[0], [1], [2]]
select = { method = "fixed" }
"#;

fn from_files(fitted: &Rows, test: &Rows) -> Outcome {
    let folder = std::env::temp_dir().join(format!("rsm-in-memory-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for (name, rows) in [("data.csv", fitted), ("test.csv", test)] {
        let mut text = "a[m],b[s],plain[N],even[N],inverse[N],weight[1],group[1]\n".to_string();
        for row in 0..rows.a.len() {
            let [plain, even, inverse] = [0, 1, 2].map(|k| rows.responses[k][row]);
            text += &format!(
                "{},{},{plain},{even},{inverse},{},{}\n",
                rows.a[row], rows.b[row], rows.weights[row], rows.groups[row]
            );
        }
        std::fs::write(folder.join(name), text).unwrap();
    }
    let specification = Specification::from_source(Source::new("fit.toml", SPECIFICATION), folder.clone()).unwrap();
    let outcome = fit(&specification, &mut |_| {}).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    outcome
}

fn from_memory(fitted: &Rows, test: &Rows) -> Outcome {
    let inputs = |rows: &Rows| {
        [Input::new("a", &rows.a).unit("m").range([-2.5, 2.5]), Input::new("b", &rows.b).unit("s").extrapolated()]
    };
    let response = |rows: &Rows, k: usize| Response::new(["plain", "even", "inverse"][k], &rows.responses[k]).unit("N");
    let responses = [
        response(fitted, 0)
            .inputs(["a", "b"])
            .weights(&fitted.weights)
            .output_range([-40.0, 40.0])
            .supported_by_data(0.05)
            .select(Select::ladder(3, 99.0)),
        response(fitted, 1)
            .inputs(["b", "a"])
            .standard_errors(&fitted.weights)
            .symmetry("a", Symmetry::Even)
            .constraint(Constraint::Bounds { min: Some(-1.0), max: None }),
        response(fitted, 2).inputs(["b"]).reciprocal("b").select(Select::terms([[0], [1], [2]])),
    ];
    Fit::new(inputs(fitted), responses)
        .name("bench")
        .order(3)
        .validate_share(0.25, 3)
        .test(inputs(test), [0, 1, 2].map(|k| response(test, k)))
        .groups(&fitted.groups)
        .fit()
        .unwrap()
}

/// The model without the names of its files.
fn without_files(mut model: Model) -> String {
    for surface in &mut model.surfaces {
        surface.evidence.retain(|(name, _)| !["data", "specification", "test", "weights"].contains(&name.as_str()));
    }
    model_file::write(&model)
}

#[test]
fn rows_in_memory_give_the_bits_that_they_give_from_files() {
    let (fitted, test) = (rows(80, 1), rows(20, 2));
    let (files, memory) = (from_files(&fitted, &test), from_memory(&fitted, &test));
    assert_eq!(memory.model.surfaces.len(), 3);
    assert!(matches!(memory.response("plain").unwrap().verdict, Verdict::Reached { .. }), "{:?}", memory.responses[0].verdict);
    assert_eq!(without_files(memory.model.clone()), without_files(files.model));
    assert_eq!(memory.responses, files.responses);
    let rows: Vec<_> = memory.files.iter().map(|file| (file.name.as_str(), file.rows)).collect();
    assert_eq!(rows, [("rows in memory", 80), ("test rows in memory", 20)]);
    let evidence = &memory.model.surfaces[0].evidence;
    assert!(evidence.iter().all(|(name, _)| name != "specification"), "there is no text to name");
    let Some((_, Evidence::List(data))) = evidence.iter().find(|(name, _)| name == "data") else {
        panic!("no data: {evidence:?}")
    };
    assert_eq!(data.len(), 1);
    // The written model is read back: a model that was fitted in memory is checked, lowered and emitted like any other.
    memory.checked().unwrap();
}

#[test]
fn every_shape_of_numbers_is_the_same_rows() {
    let points = [[0.0, 1.0], [1.0, 3.0], [2.0, 2.0], [3.0, 5.0], [1.0, 4.0]];
    let values = [1.0, 4.0, 3.5, 6.0, 5.5];
    let nested: Vec<Vec<f64>> = points.iter().map(|point| point.to_vec()).collect();
    let matrix = DMatrix::from_fn(5, 2, |row, column| points[row][column]);
    let vector = DVector::from_row_slice(&values);
    let columns: Vec<Input> = (0..2).map(|k| Input::new(format!("x{}", k + 1), matrix.column(k).as_slice())).collect();
    let terms = |fit: Fit| fit.order(1).fit().unwrap().model;
    let expected = terms(Fit::new(&points, &values));
    assert_eq!(expected.inputs.iter().map(|input| input.name.as_str()).collect::<Vec<_>>(), ["x1", "x2"]);
    let others = [
        Fit::new(&points[..], &values[..]),
        Fit::new(&points.to_vec(), &values.to_vec()),
        Fit::new(&nested, &vector),
        Fit::new(nested.as_slice(), &vector),
        Fit::new(&matrix, &vector),
        Fit::new(&matrix.columns(0, 2), Response::new("y", values)),
        Fit::new(columns, vec![Response::new("y", values)]),
    ];
    for fit in others {
        assert_eq!(terms(fit), expected);
    }
    let two = Fit::new(&points, &points).order(1).fit().unwrap();
    assert_eq!(two.responses.iter().map(|response| response.name.as_str()).collect::<Vec<_>>(), ["y1", "y2"]);
}

#[test]
fn groups_are_left_out_together() {
    let fitted = rows(60, 4);
    let inputs = || [Input::new("a", &fitted.a), Input::new("b", &fitted.b)];
    let fit = |grouped: bool| {
        let fit = Fit::new(inputs(), Response::new("y", &fitted.responses[0])).order(1);
        let fit = if grouped { fit.groups(fitted.a.iter().map(|a| *a > 0.0)) } else { fit };
        fit.fit().unwrap().statistics("y").unwrap().cross_validation.clone().unwrap().parts
    };
    // Two groups give two parts; without groups there are more.
    assert_eq!(fit(true), 2);
    assert!(fit(false) > 2);
}

/// A request, and the expected message.
type Case = (&'static str, Fit, &'static str);

#[test]
fn what_cannot_be_fitted_is_told_in_words() {
    let x = [1.0, 2.0, 3.0, 4.0];
    let y = || Response::new("y", x);
    let plain = || Fit::new(&x, &x);
    let cases: Vec<Case> = vec![
        ("infinite", Fit::new(&[1.0, f64::INFINITY], &[1.0, 2.0]), "input `x1`: row 2: found inf, expected a finite number"),
        ("short", Fit::new(&x, &[1.0]), "response `y`: found 1 rows, expected 4"),
        ("ragged", Fit::new(&vec![vec![1.0, 2.0], vec![1.0]], &[1.0, 2.0]), "inputs: row 2: found 1 values, expected 2"),
        ("empty", Fit::new(&[] as &[f64], &[] as &[f64]), "found no row, expected at least one"),
        ("no input", Fit::new(Vec::<Input>::new(), &x), "`inputs`: found none, expected at least one"),
        ("no response", Fit::new(&x, Vec::<Response>::new()), "`responses`: found none, expected at least one"),
        ("huge", Fit::new(&x, &[1.0, 2.0, 3.0, 1e200]), "response `y`: row 4: found 1e200, expected a magnitude up to 1e150"),
        ("name", plain().name("while"), "model name `while` is a keyword"),
        ("twice", Fit::new([Input::new("a", x), Input::new("a", x)], &x), "input name `a` is given twice"),
        ("unit", Fit::new(Input::new("a", x).unit("parsnip"), &x), "`unit`: "),
        ("range", Fit::new(Input::new("a", x).range([2.0, 1.0]), &x), "`range`: low 2 is not below high 1"),
        ("range NaN", Fit::new(Input::new("a", x).range([f64::NAN, 1.0]), &x), "input `a`: `range`: found NaN"),
        ("order", plain().order(0), "response `y`: the order: found 0, expected a whole number from 1 to 20"),
        ("power", plain().terms([[21]]), "response `y`: a term: found the power 21, expected at most 20"),
        ("both", plain().terms([[1]]).ladder(99.0), "response `y`: found both terms and a method that chooses them"),
        ("powers", plain().terms([[1, 1]]), "response `y`: term 1: found 2 powers, expected one for each of 1 inputs"),
        ("confidence", plain().ladder(101.0), "`confidence`: found 101, expected percent"),
        ("few", plain().order(4), "response `y`: found 4 rows to fit, expected at least 5, one for each term"),
        ("weights", Fit::new(&x, y().weights([1.0, 1.0, 0.0, 1.0])), "response `y`: the weight of row 3: found 0"),
        ("some weights", Fit::new(&x, y().weights([1.0])), "response `y`: the weights: found 1 rows, expected 4"),
        ("unknown", Fit::new(&x, y().inputs(["z"])), "response `y`: there is no input `z`"),
        ("knot", Fit::new(&x, y().knot("x1", 9.0)), "response `y`: knot 1: found x1 = 9, expected a value between 1 and 4"),
        ("odd", Fit::new(&x, y().symmetry("x1", Symmetry::Odd).select(Select::order(1))), ""),
        ("bounds", Fit::new(&x, y().constraint(Constraint::Bounds { min: None, max: None })), "constraint 1: found neither"),
        ("margin", Fit::new(&x, y().supported_by_data(-1.0)), "the margin of the support: found -1, expected 0 or more"),
        ("faces", Fit::new(&x, y().support_faces(6)), "the faces of the support belong to responses of two inputs"),
        (
            "many faces",
            Fit::new(&x, y().support_faces(33)),
            "the faces of the support: found 33, expected a whole number from 4",
        ),
        ("share", plain().validate_share(1.0, 1), "`validate`: `share`: found 1, expected more than 0 and less than 1"),
        ("test", plain().test(&[[1.0, 2.0]], &[1.0]), "test rows: found 2 inputs, expected 1"),
        ("test names", plain().test(Input::new("b", [1.0]), &[1.0]), "test rows: input `x1`: found `b` in its place"),
        ("groups", plain().groups([1]), "the groups: found 1 rows, expected 4"),
        ("mirror", plain().mirror(["z"]), "`mirror`: there is no input `z`"),
        ("run order", plain().run_order([1.0]), "the run order: found 1 rows, expected 4"),
    ];
    for (name, fit, expected) in cases {
        match fit.fit() {
            // An odd response needs no symmetric data: the range is made symmetric.
            Ok(_) => assert_eq!(expected, "", "{name}: nothing was told"),
            Err(refused) => {
                let told = refused.to_string();
                assert!(
                    !expected.is_empty() && told.contains(&format!("fit: {expected}")) || told.contains(expected),
                    "{name}: {told}"
                );
                assert!(told.lines().all(|line| line.starts_with("fit: ") || line.starts_with("  help: ")), "{name}: {told}");
            }
        }
    }
}
