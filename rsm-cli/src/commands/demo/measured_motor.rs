//! The cost of the measured motor's surfaces compared with the solver, in words. The numbers come from a budget that a test compares with the
//! measured map.

const BUDGET: &str = include_str!("../../../../examples/measured-motor/budget.txt");

/// Instructions of a controller on a Cortex-M4F: mean and maximum.
fn instructions(controller: &str) -> [u32; 2] {
    let costs = BUDGET.lines().find_map(|line| line.strip_prefix(controller)?.trim_start().strip_prefix("cost "));
    let costs: Vec<u32> = costs.into_iter().flat_map(str::split_whitespace).filter_map(|word| word.parse().ok()).collect();
    let [mean, _, most, _] = costs[..] else { panic!("the budget has no four costs of the {controller}") };
    [mean, most]
}

/// The cost as a sentence without a full stop: "184 instructions on a Cortex-M4F, the solver ...".
pub(super) fn cost() -> String {
    let ([_, own], [mean, most]) = (instructions("surfaces"), instructions("full controller"));
    let times = |solver: u32| f64::from(solver) / f64::from(own);
    format!(
        "{own} instructions on a Cortex-M4F, the solver {mean} in the mean ({:.0} times as many) and {most} at most ({:.0} times)",
        times(mean),
        times(most)
    )
}

#[cfg(test)]
mod tests {
    /// `tests/all/measured_motor.rs` compares the book's table with the measured map.
    #[test]
    fn the_first_sentences_of_the_page_agree_with_the_table_of_the_book() {
        let book = include_str!("../../../../docs/book/src/results/demo.md");
        let sentence_part = super::cost();
        let cell = |name: &str, column: usize| {
            let row = book.lines().find_map(|line| line.strip_prefix(&format!("| {name} | "))).expect("a row");
            row.split(" | ").nth(column).expect("a cell").to_string()
        };
        let number = |name, column| cell(name, column).parse::<f64>().expect("a number");
        let [own, mean, most] = [number("surfaces", 3), number("full controller", 2), number("full controller", 3)];
        let [mean_times, most_times] = [mean, most].map(|solver| (solver / own).round());
        assert_eq!(
            sentence_part,
            format!(
                "{own} instructions on a Cortex-M4F, the solver {mean} in the mean ({mean_times} times as many) and {most} at most ({most_times} times)"
            )
        );
        let sentence = format!("takes {most_times} times the instructions of the surfaces, its mean {mean_times} times");
        assert!(book.contains(&sentence), "the book does not say `{sentence}`");
    }
}
