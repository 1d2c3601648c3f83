use super::*;
use crate::number::exact;
use crate::run::Interpreter;

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| name.to_string()).collect()
}

const NO_STATES: [(&str, Reg); 0] = [];

#[test]
fn a_tape_with_several_results_gives_all_of_them_in_order() {
    let mut tape = TapeBuilder::new(Precision::F64);
    let (x, y) = (tape.input(0), tape.input(1));
    let (sum, product) = (tape.add(x, y), tape.multiply(x, y));
    let tape = tape.finish_with_results("both", names(&["x", "y"]), [("product", product), ("sum", sum)], NO_STATES);
    let mut results = [0.0; 2];
    Interpreter::<f64>::new(&tape).eval_all(&[3.0, 5.0], &mut results);
    assert_eq!(results, [15.0, 8.0]);
    assert_eq!(Interpreter::<f64>::new(&tape).eval(&[3.0, 5.0]), 15.0, "one alone is the first");
    assert_eq!(crate::exact::ideal_all(&tape, &[exact(3.0), exact(5.0)]), Some(vec![exact(15.0), exact(8.0)]));
    assert!(tape.to_string().ends_with("  return product = r3\n  return sum = r2\n"), "{tape}");
    let [of_product, of_sum] = crate::rounding::error_bounds(&tape, &[[1.0, 1.9], [1.0, 1.9]])[..] else { panic!() };
    // Half a unit in the last place of a number up to 4: 2^-52.
    assert!((2f64.powi(-53)..=2f64.powi(-52)).contains(&of_product), "{of_product:e}");
    assert!((2f64.powi(-53)..=2f64.powi(-52)).contains(&of_sum), "{of_sum:e}");
    let mut values = crate::values::Values::new(&tape);
    let one_to_two = crate::interval::Interval::new(1.0, 2.0);
    assert_eq!(values.over(&[one_to_two; 2]), crate::interval::Interval::new(1.0, 4.0));
    assert_eq!(values.of(tape.outputs[1].reg), crate::interval::Interval::new(2.0, 4.0));
}

#[test]
fn named_states_move_from_step_to_step() {
    let mut tape = TapeBuilder::new(Precision::F64);
    let (x, sum, count) = (tape.input(0), tape.state(0), tape.state(1));
    let one = tape.constant(exact(1.0));
    let (next_sum, next_count) = (tape.add(sum, x), tape.add(count, one));
    let states = [("sum", next_sum), ("count", next_count)];
    let tape = tape.finish_with_results("mean", names(&["x"]), [("sum", next_sum)], states);
    let mut steps = Interpreter::<f64>::new(&tape);
    for x in [4.0, 5.0, 6.0] {
        steps.step(&[x]);
    }
    assert_eq!(steps.states(), [15.0, 3.0]);
    assert_eq!(tape.states[1].name, "count");
}

#[test]
fn each_operation_is_the_one_of_its_name() {
    let result = |write: &dyn Fn(&mut TapeBuilder, Reg, Reg) -> Reg| {
        let mut tape = TapeBuilder::new(Precision::F64);
        let (a, b) = (tape.input(0), tape.input(1));
        let result = write(&mut tape, a, b);
        Interpreter::<f64>::new(&tape.finish("t", names(&["a", "b"]), result)).eval(&[-6.0, 4.0])
    };
    assert_eq!(result(&|t, a, _| t.negate(a)), 6.0);
    assert_eq!(result(&|t, a, _| t.absolute(a)), 6.0);
    assert_eq!(result(&|t, a, b| t.add(a, b)), -2.0);
    assert_eq!(result(&|t, a, b| t.subtract(a, b)), -10.0);
    assert_eq!(result(&|t, a, b| t.multiply(a, b)), -24.0);
    assert_eq!(result(&|t, a, b| t.divide(a, b)), -1.5);
    assert_eq!(result(&|t, a, b| t.select_less(a, b, a, b)), -6.0);
    assert_eq!(result(&|t, a, b| t.select_less(b, a, a, b)), 4.0);
    assert_eq!(result(&|t, a, b| t.at_least(a, b)), 4.0);
    assert_eq!(result(&|t, a, b| t.at_most(b, a)), -6.0);
    assert_eq!(result(&|t, a, _| t.times(a, exact(-1.0))), 6.0);
    assert_eq!(result(&|t, a, _| t.times(a, exact(0.5))), -3.0);
}

#[test]
fn a_sharing_tape_writes_an_operation_once() {
    for (shares, expected) in [(true, 4), (false, 5)] {
        let mut tape = if shares { TapeBuilder::sharing(Precision::F64) } else { TapeBuilder::new(Precision::F64) };
        assert!(tape.is_empty());
        let (x, two) = (tape.input(0), tape.constant(exact(2.0)));
        let (first, second) = (tape.multiply(x, two), tape.multiply(x, two));
        assert_eq!(first == second, shares);
        // Another order of operands, or another operation, is a different operation; a constant is never written twice.
        assert_eq!(tape.constant(exact(2.0)), two);
        let turned = tape.multiply(two, x);
        assert!(turned != first && *tape.op(turned) == Op::Multiply(two, x));
        assert_eq!(tape.len(), expected);
        assert_ne!(tape.add(x, two), first);
    }
    // Numbers that round to one value are as many constants; +0 and -0 are one.
    let mut tape = TapeBuilder::new(Precision::F64);
    let (tenth, value) = (integer(1) / integer(10), exact(0.1));
    let both = [tape.constant(tenth.clone()), tape.constant(value.clone())];
    assert!(both[0] != both[1] && tape.op(both[0]) != tape.op(both[1]));
    assert_eq!([tape.constant(tenth), tape.constant(value)], both);
    let zero = [0.0, -0.0].map(|value| tape.rounded_constant(value, integer(0)));
    assert!(zero[0] == zero[1] && tape.len() == 3);
    // An input and a state with the same number are two operations.
    let mut tape = TapeBuilder::sharing(Precision::F32);
    assert_ne!(tape.input(0), tape.state(0));
    assert_eq!(tape.input(0), tape.input(0));
}

#[test]
fn a_tape_stands_inside_another_with_all_its_operations() {
    let mut inner = TapeBuilder::new(Precision::F64);
    let (a, b) = (inner.input(0), inner.input(1));
    let three = inner.constant(exact(3.0));
    let each = [inner.negate(a), inner.absolute(a), inner.add(a, b), inner.subtract(a, b), inner.multiply(a, b)];
    let more = [inner.divide(a, three), inner.select_less(a, b, a, three), inner.select_less(b, a, a, three)];
    let results: Vec<_> = each.into_iter().chain(more).map(|reg| ("r", reg)).collect();
    inner.note(&exact(3.0), Note { term: "constant".to_string(), coefficient: 3.0, unit: "m".to_string() });
    let inner = inner.finish_with_results("inner", names(&["a", "b"]), results, NO_STATES);
    let mut direct = [0.0; 8];
    Interpreter::<f64>::new(&inner).eval_all(&[-6.0, 4.0], &mut direct);

    let mut outer = TapeBuilder::sharing(Precision::F64);
    // Inputs in another order, after another operation: registers get new numbers.
    let (b, a) = (outer.input(0), outer.input(1));
    let a = outer.negate(a);
    let inside = outer.inline(&inner, &[a, b]);
    assert_eq!(outer.inline(&inner, &[a, b]), inside, "the second time nothing is written");
    let outer = outer.finish_with_results("outer", names(&["b", "a"]), inside.iter().map(|reg| ("r", *reg)), NO_STATES);
    let mut found = [0.0; 8];
    Interpreter::<f64>::new(&outer).eval_all(&[4.0, 6.0], &mut found);
    assert_eq!(found, direct);
    assert_eq!(outer.notes.len(), 1);
    assert_eq!(*outer.op(outer.notes[0].0), Op::Constant(Constant { value: 3.0, exact: exact(3.0) }));
}

#[test]
#[should_panic(expected = "input 1 has no name")]
fn an_input_without_a_name_is_refused() {
    let mut tape = TapeBuilder::new(Precision::F64);
    let x = tape.input(1);
    let _ = tape.finish("t", names(&["x"]), x);
}

#[test]
#[should_panic(expected = "state 0 has no next value")]
fn a_state_without_a_next_value_is_refused() {
    let mut tape = TapeBuilder::new(Precision::F64);
    let x = tape.state(0);
    let _ = tape.finish("t", vec![], x);
}
