use super::*;

/// A pool with the symbols x and y.
fn pool() -> (Pool, Id, Id) {
    let mut pool = Pool::default();
    let x = pool.symbol(Symbol(0));
    let y = pool.symbol(Symbol(1));
    (pool, x, y)
}

fn at(pool: &Pool, id: Id, x: f64, y: f64) -> f64 {
    let mut values = Values::new(pool);
    values.set(Symbol(0), x);
    values.set(Symbol(1), y);
    values.of(id)
}

#[test]
fn a_node_stands_once_and_trivial_operations_vanish() {
    let (mut pool, x, y) = pool();
    let zero = pool.number(-0.0);
    let one = pool.number(1.0);
    assert_eq!(pool.add(x, y), pool.add(y, x));
    assert_eq!(pool.add(x, zero), x);
    assert_eq!(pool.multiply(one, x), x);
    assert_eq!(pool.multiply(zero, x), zero);
    assert_eq!(pool.subtract(x, x), zero);
    let minus = pool.negate(x);
    assert_eq!(pool.negate(minus), x);
    assert_eq!(pool.add(y, minus), pool.subtract(y, x));
    let (two, three) = (pool.number(2.0), pool.number(3.0));
    assert_eq!(pool.add(two, three), pool.number(5.0));
    assert_eq!(pool.divide(x, one), x);
}

#[test]
fn a_whole_power_is_a_chain_of_products() {
    let (mut pool, x, _) = pool();
    for exponent in [-5_i32, -1, 1, 2, 3, 7, 10] {
        let e = pool.number(f64::from(exponent));
        let power = pool.binary(Binary::Power, x, e);
        assert!(pool.reachable(&[power]).iter().all(|id| !matches!(pool.node(*id), Node::Binary(Binary::Power, ..))));
        let wanted = 1.7_f64.powi(exponent);
        // At most 11 roundings of 2^-53 each.
        assert!((at(&pool, power, 1.7, 0.0) - wanted).abs() <= 2e-15 * wanted);
    }
}

/// Every operation against a central difference of step 1e-5: its error is of the order 1e-10 for third derivatives of order 1, plus
/// rounding 1e-16/1e-5.
#[test]
fn derivatives_are_those_of_differences() {
    let (mut pool, x, y) = pool();
    let unary = [
        Unary::Negate,
        Unary::Absolute,
        Unary::Root,
        Unary::Sine,
        Unary::Cosine,
        Unary::Tangent,
        Unary::Arcsine,
        Unary::Arccosine,
        Unary::Arctangent,
        Unary::SineHyperbolic,
        Unary::CosineHyperbolic,
        Unary::TangentHyperbolic,
        Unary::Exponential,
        Unary::Logarithm,
        Unary::Logarithm10,
    ];
    let binary = [
        Binary::Add,
        Binary::Subtract,
        Binary::Multiply,
        Binary::Divide,
        Binary::Power,
        Binary::Minimum,
        Binary::Maximum,
        Binary::Arctangent2,
    ];
    let product = pool.multiply(x, y);
    let mut all: Vec<Id> = unary.iter().map(|operation| pool.unary(*operation, product)).collect();
    let shifted = pool.add(x, product);
    all.extend(binary.iter().map(|operation| pool.binary(*operation, shifted, y)));
    for id in all {
        for (symbol, dx, dy) in [(Symbol(0), 1e-5, 0.0), (Symbol(1), 0.0, 1e-5)] {
            let derived = Derivative::by(&mut pool, symbol).of(&mut pool, id);
            let (u, v) = (0.62, 0.87);
            let difference = (at(&pool, id, u + dx, v + dy) - at(&pool, id, u - dx, v - dy)) / 2e-5;
            let found = at(&pool, derived, u, v);
            assert!((found - difference).abs() < 1e-8, "{:?}: {found}, {difference}", pool.node(id));
        }
    }
}

#[test]
fn text_has_the_parentheses_that_it_needs() {
    let (mut pool, x, y) = pool();
    let name = |symbol: Symbol| ["x", "y"][symbol.0 as usize].to_string();
    let difference = pool.subtract(x, y);
    let inner = pool.subtract(y, difference);
    let quotient = pool.divide(x, inner);
    let less = pool.binary(Binary::Less, x, y);
    let not = pool.unary(Unary::Not, less);
    let choice = pool.choose(less, quotient, difference);
    let text = |id| pool.text(id, &name, &|_| String::new());
    assert_eq!(text(quotient), "x/(y - (x - y))");
    assert_eq!(text(not), "x >= y");
    assert_eq!(text(choice), "if x < y then x/(y - (x - y)) else x - y");
}

#[test]
fn replaced_symbols_are_simplified_again() {
    let (mut pool, x, y) = pool();
    let product = pool.multiply(x, y);
    let sum = pool.add(product, x);
    let zero = pool.number(0.0);
    let replaced = Replacement::new(HashMap::from([(Symbol(1), zero)])).of(&mut pool, sum);
    assert_eq!(replaced, x);
}
