use rsm_core::source::Source;

use super::*;
use crate::expression::Values;

fn read(text: &str) -> Result<Flat, String> {
    Flat::read(&Source::new("m.mo", text), &Options::default()).map_err(|faults| faults.to_string())
}

/// A model of these declarations and equations.
fn model(declarations: &str, equations: &str) -> Result<Flat, String> {
    read(&format!("model M\n{declarations}\nequation\n{equations}\nend M;\n"))
}

fn lines(flat: &Flat) -> Vec<String> {
    flat.equations.iter().map(|equation| format!("{} = {}", flat.text(equation.left), flat.text(equation.right))).collect()
}

#[test]
fn arrays_are_written_out() {
    let flat = model(
        "parameter Integer n = 2 + 1; parameter Real A[2,2] = {{1,2},{3,4}}; Real x[n](each start = 1); Real y[2], z[2]; Real s;",
        "der(x) = -x; y = A*{x[1], x[end]}; for i in 1:2 loop z[i] = y[i]/i; end for; s = sum(x[2:3]) + x*x;",
    )
    .unwrap();
    assert_eq!(
        lines(&flat),
        [
            "der(x[1]) = -x[1]",
            "der(x[2]) = -x[2]",
            "der(x[3]) = -x[3]",
            "y[1] = A[1,1]*x[1] + A[1,2]*x[3]",
            "y[2] = A[2,1]*x[1] + A[2,2]*x[3]",
            "z[1] = y[1]",
            "z[2] = y[2]/2",
            "s = x[2] + x[3] + (x[1]*x[1] + x[2]*x[2] + x[3]*x[3])",
        ]
    );
    let n = flat.variable(flat.find("n").unwrap());
    assert!(n.is_structural);
    assert!(flat.find("x[3]").is_some());
}

#[test]
fn a_function_is_followed_through_its_branches() {
    let flat = read(
        "function f\n input Real v; input Real c;\n output Real y;\nprotected\n Real a;\nalgorithm\n a := abs(v);\n if a > 1 then\n  y := c*v;\n \
         elseif a > 0.5 then\n  y := 2*c;\n else\n  y := 0;\n end if;\n y := y + 1;\nend f;\nmodel M\n Real x;\nequation\n x = f(time, c = 3);\nend M;",
    )
    .unwrap();
    let right = flat.equations[0].right;
    for (time, wanted) in [(2.0, 7.0), (-0.7, 7.0), (0.2, 1.0)] {
        let mut values = Values::new(&flat.pool);
        values.set(Symbol(0), time);
        assert_eq!(values.of(right).to_bits(), f64::to_bits(wanted));
    }
}

#[test]
fn a_function_without_algorithm_is_a_surface() {
    let flat = read(
        "function map\n input Real n(unit = \"rad/s\"); input Real u;\n output Real t(unit = \"N.m\");\nend map;\nmodel M\n Real x(start = 1), y;\n\
         equation\n der(x) = map(x, 2); y = map(x, time);\nend M;",
    )
    .unwrap();
    assert_eq!(flat.surfaces.len(), 1);
    assert_eq!(flat.surfaces[0].inputs[0], ("n".to_string(), Some("rad/s".to_string())));
    assert_eq!(lines(&flat), ["der(x) = map(x, 2)", "y = map(x, time)"]);
}

#[test]
fn if_equations_have_as_many_equations_as_a_branch() {
    let flat = model(
        "parameter Boolean on = true; Real x, y, v, i;",
        "if x > 1 then x = 2; y = 3; else y = 4; x = time; end if; if on then v = 0; else i = 0; end if; if on then v = i; end if;",
    )
    .unwrap();
    assert_eq!(lines(&flat), ["y = if 1 < x then 3 else 4", "x = if 1 < x then 2 else time", "v = 0", "v = i",]);
    assert!(flat.variable(flat.find("on").unwrap()).is_structural);
}

#[test]
fn events_are_collected() {
    let flat = model(
        "parameter Real T = 0.1; Real v(start = 1); discrete Real u(start = 0); Boolean b(start = false);",
        "der(v) = u; b = v > 1 or (pre(b) and v > 0.5);\nwhen sample(0, T) then u = pre(u) + T*v; end when;\n\
         when {v < 0, edge(b)} then reinit(v, -0.5*pre(v)); elsewhen v > 9 then if b then reinit(v, 1); end if; end when; assert(v < 100, \"fast\");",
    )
    .unwrap();
    assert_eq!(flat.clauses.len(), 3);
    assert_eq!(flat.clauses[1].conditions.len(), 2);
    assert_eq!(flat.clauses[2].unless, [1]);
    assert_eq!((flat.samples.len(), flat.checks.len()), (1, 1));
    assert_eq!(flat.text(flat.clauses[2].restarted[0].1), "if b then 1 else v");
    assert!(flat.variable(flat.find("u").unwrap()).is_discrete);
}

#[test]
fn types_and_attributes_reach_the_variables() {
    let flat = read(
        "package P\n type V = Real(unit = \"V\", min = -5);\n constant Real g = 9.81;\n model M\n  parameter Real J(unit = \"kg.m2\") = 2*g;\n  \
         input Real part.u = 3;\n  V u(start = 2*J, fixed = true, nominal = 10, stateSelect = StateSelect.prefer) \"voltage\";\n equation\n  \
         der(u) = part.u;\n end M;\nend P;",
    )
    .unwrap();
    let u = flat.variable(flat.find("u").unwrap());
    assert_eq!((u.unit.as_deref(), u.min, u.nominal, u.fixed), (Some("V"), Some(-5.0), Some(10.0), Some(true)));
    assert_eq!((u.description.as_str(), u.preference), ("voltage", Preference::Prefer));
    assert_eq!(flat.text(u.start.unwrap()), "2*J");
    // An input with a value inside the text is an unknown with an equation.
    assert_eq!(flat.variable(flat.find("part.u").unwrap()).role, Role::Unknown);
    assert_eq!(flat.equations.len(), 2);
}

#[test]
fn parameters_from_outside_take_the_place_of_the_text() {
    let text = "model M\n parameter Integer n = 2;\n parameter Real k;\n Real x[n];\nequation\n for i in 1:n loop x[i] = k*i; end for;\nend M;";
    let source = Source::new("m.mo", text);
    let options = |list: &[(&str, f64)]| Options {
        parameters: list.iter().map(|(name, value)| ((*name).to_string(), *value)).collect(),
        ..Options::default()
    };
    let told = Flat::read(&source, &Options::default()).unwrap_err().to_string();
    assert!(told.contains("m.mo:3:17: the parameter `k` has no value"), "{told}");
    let flat = Flat::read(&source, &options(&[("n", 3.0), ("k", 1.5)])).unwrap();
    assert_eq!(flat.equations.len(), 3);
    let told = Flat::read(&source, &options(&[("k", 1.0), ("q", 1.5), ("x[1]", 1.0)])).unwrap_err().to_string();
    assert!(told.contains("no parameter `q`") && told.contains("`x[1]` is not a parameter"), "{told}");
}

#[test]
fn all_faults_of_names_types_and_shapes_are_told_at_once() {
    let told = model(
        "Real speed, y[2];\n Boolean b;\n Volt v;\n Real speed;\n Real w(start = true, colour = 1);",
        "sped = 1;\n speed = b + 1;\n y = {1, 2, 3};\n speed = y[3];\n b = 2;\n speed = foo(1);\n speed = delay(y[1], 0.1);\n speed = sin(1, 2);\n \
         if speed then speed = 1; end if;\n speed = 1.0 == speed;\n reinit(speed, 1);",
    )
    .unwrap_err();
    for (place, what) in [
        ("4:2", "the type `Volt`"),
        ("5:7", "declared twice"),
        ("6:17", "`start` of a variable of type Real is of type Boolean"),
        ("6:23", "`colour` is not an attribute"),
        ("8:1", "`sped` is not declared"),
        ("9:10", "found a Boolean"),
        ("10:2", "a vector of 2 and a vector of 3"),
        ("11:12", "the subscript is 3, expected 1 to 2"),
        ("12:2", "between Boolean and Integer"),
        ("13:10", "`foo` is not declared"),
        ("14:10", "`delay(...)` is not supported"),
        ("15:10", "`sin` has 2 arguments"),
        ("16:5", "expected a condition"),
        ("17:10", "for equality"),
        ("18:2", "outside of a `when`"),
    ] {
        assert!(told.contains(&format!("m.mo:{place}: ")) && told.contains(what), "{place} {what} is missing in\n{told}");
    }
    assert!(told.contains("there is `speed`"));
    assert_eq!(told.matches("m.mo:").count(), 15, "{told}");
}

#[test]
fn endless_calls_and_sizes_are_faults() {
    let told =
        read("function f\n input Real a;\n output Real b;\nalgorithm\n b := f(a);\nend f;\nmodel M\n Real x = f(1);\nend M;")
            .unwrap_err();
    assert!(told.contains("calls itself"), "{told}");
    let told = model("Real x[1000000000];", "").unwrap_err();
    assert!(told.contains("the size is 1000000000"), "{told}");
    let told = model("parameter Integer a = b; parameter Integer b = a; Real x[a];", "").unwrap_err();
    assert!(told.contains("known while the text is read"), "{told}");
}

#[test]
fn a_parameter_from_outside_chooses_the_equations() {
    let text = "model M\n  parameter Boolean holds = false;\n  output Real x;\n  Real y;\nequation\n  if holds then\n    x = 0.0;\n  else\n    y = 1.0;\n  \
                end if;\n  der(x) = y;\nend M;\n";
    let lines = |holds: f64| {
        let options = Options { model: None, parameters: vec![("holds".to_string(), holds)] };
        let flat = Flat::read(&Source::new("m.mo", text), &options).unwrap();
        let sides = |it: &Equation| format!("{} = {}", flat.text(it.left), flat.text(it.right));
        flat.equations.iter().map(sides).collect::<Vec<_>>()
    };
    assert_eq!(lines(0.0), ["y = 1", "der(x) = y"]);
    assert_eq!(lines(1.0), ["x = 0", "der(x) = y"]);
}
