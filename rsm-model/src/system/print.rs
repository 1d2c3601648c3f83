//! A readable listing of the system: states, inputs, the solution of each equation, switches, events.

use std::fmt::{self, Write as _};

use crate::expression::{Id, Symbol};

use super::{Method, System};

/// The listing that `rsm inspect` prints.
impl fmt::Display for System {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let flat = &self.flat;
        write!(f, "model {}", flat.name)?;
        if !flat.description.is_empty() {
            write!(f, ": {}", flat.description)?;
        }
        writeln!(f)?;
        self.list(f, "states", self.states(), |system, symbol| {
            let variable = system.flat.variable(symbol);
            let start = variable.start.map_or_else(|| "0".to_string(), |start| system.text(start));
            format!("starts at {start}{}", if variable.fixed == Some(true) { ", fixed" } else { "" })
        })?;
        self.list(f, "inputs", &self.inputs(), |_, _| String::new())?;
        self.list(f, "outputs", &self.outputs(), |_, _| String::new())?;
        self.list(f, "parameters", &self.parameters(), |system, symbol| {
            system.parameter_value(symbol).map_or_else(String::new, |value| format!("= {value}"))
        })?;
        let structural: Vec<Symbol> = flat.symbols().filter(|symbol| flat.variable(*symbol).is_structural).collect();
        self.list(f, "parameters that shape the system", &structural, |system, symbol| {
            system.parameter_value(symbol).map_or_else(String::new, |value| format!("= {value}"))
        })?;
        writeln!(f, "equations, in the order of solution")?;
        for block in &self.blocks {
            let method = match block.method {
                Method::Given | Method::Turned => "",
                Method::Linear => ", a linear block",
                Method::Newton => ", by Newton's method",
            };
            let lines: Vec<String> = block.lines.iter().map(usize::to_string).collect();
            writeln!(f, "  line {}{method}", lines.join(", "))?;
            for unknown in &block.unknowns {
                match (block.method, self.solved.iter().find(|(symbol, _)| symbol == unknown)) {
                    (Method::Given | Method::Turned, Some((_, value))) => {
                        writeln!(f, "    {} = {}", self.name(*unknown), self.text(*value))?;
                    }
                    _ => writeln!(f, "    {}", self.name(*unknown))?,
                }
            }
        }
        if !self.aliases.is_empty() {
            writeln!(f, "other names")?;
            let mut aliases: Vec<_> = self.aliases.iter().collect();
            aliases.sort_unstable_by_key(|(symbol, _)| **symbol);
            for (symbol, alias) in aliases {
                let sign = if alias.is_negative { "-" } else { "" };
                writeln!(f, "  {} = {sign}{}", self.name(*symbol), self.name(alias.of))?;
            }
        }
        if !self.switches.is_empty() {
            writeln!(f, "switches, located in time")?;
            for (k, switch) in self.switches.iter().enumerate() {
                writeln!(f, "  {}: {} < {}", k + 1, self.text(switch.left), self.text(switch.right))?;
            }
        }
        if !self.flat.clauses.is_empty() {
            writeln!(f, "events")?;
            for clause in &self.flat.clauses {
                let conditions: Vec<String> = clause.conditions.iter().map(|id| self.text(*id)).collect();
                let mut line = format!("  when {}:", conditions.join(" or "));
                let all = clause.assigned.iter().map(|it| ("", it)).chain(clause.restarted.iter().map(|it| ("restart ", it)));
                for (word, (symbol, value)) in all {
                    let _ = write!(line, " {word}{} = {};", self.name(*symbol), self.text(*value));
                }
                writeln!(f, "{line}")?;
            }
        }
        for (k, sample) in self.flat.samples.iter().enumerate() {
            writeln!(f, "  sample {} from {} every {}", k + 1, self.text(sample.start), self.text(sample.period))?;
        }
        let units = self.units;
        match (units.equations, units.unchecked) {
            (0, _) => writeln!(f, "units: not checked, the text states too few"),
            (checked, 0) => writeln!(f, "units: checked in all {checked} equations"),
            (checked, rest) => writeln!(f, "units: checked in {checked} equations; {rest} contain a variable without a unit"),
        }
    }
}

impl System {
    fn list(
        &self,
        f: &mut fmt::Formatter<'_>,
        title: &str,
        symbols: &[Symbol],
        more: impl Fn(&System, Symbol) -> String,
    ) -> fmt::Result {
        if symbols.is_empty() {
            return Ok(());
        }
        writeln!(f, "{title}")?;
        for symbol in symbols {
            let variable = self.flat.variable(*symbol);
            let unit = variable.unit.as_ref().map_or_else(String::new, |unit| format!("[{unit}]"));
            let words = [format!("{}{unit}", variable.name), more(self, *symbol), variable.description.clone()];
            let words: Vec<String> = words.into_iter().filter(|word| !word.is_empty()).collect();
            writeln!(f, "  {}", words.join("  "))?;
        }
        Ok(())
    }

    /// The solution for each unknown, in the order of solution, in terms of states and earlier unknowns.
    #[must_use]
    pub fn solved(&self) -> &[(Symbol, Id)] {
        &self.solved
    }
}
