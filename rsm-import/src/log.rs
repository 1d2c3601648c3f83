//! The content of a file of any format: columns with gaps.

/// A column as it is in its file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Raw {
    pub name: String,
    pub unit: Option<String>,
    /// NaN if there is no sample.
    pub values: Vec<f64>,
    /// The texts of its cells if none of them is a number: times of day and dates.
    pub texts: Vec<String>,
}

/// A file.
#[derive(Debug, Clone)]
pub(crate) struct Log {
    pub file: String,
    pub columns: Vec<Raw>,
    /// The line of every row; empty if the file has no lines.
    pub lines: Vec<usize>,
    /// The conversions while reading.
    pub notes: Vec<String>,
    /// The names of columns that nobody wished, and that are not read.
    pub unread: Vec<String>,
}

impl Log {
    /// If two columns have the same name, the second gets a number, or is dropped if it has the same values.
    pub(crate) fn with_names_apart(mut self) -> Self {
        let mut kept: Vec<Raw> = Vec::new();
        for mut column in std::mem::take(&mut self.columns) {
            let same = |values: &[f64], others: &[f64]| {
                values.len() == others.len() && values.iter().zip(others).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
            };
            let of_the_name: Vec<&Raw> = kept.iter().filter(|it| it.name == column.name).collect();
            if of_the_name
                .iter()
                .any(|it| it.unit == column.unit && it.texts == column.texts && same(&it.values, &column.values))
            {
                self.notes.push(format!("the column `{}` occurs twice with the same values: one is left out", column.name));
                continue;
            }
            if !of_the_name.is_empty() {
                let mut number = 2;
                while kept.iter().any(|it| it.name == format!("{}_{number}", column.name)) {
                    number += 1;
                }
                let name = format!("{}_{number}", column.name);
                self.notes.push(format!(
                    "the column `{}` occurs twice with different values: the later one is called `{name}`",
                    column.name
                ));
                column.name = name;
            }
            kept.push(column);
        }
        self.columns = kept;
        self
    }

    pub(crate) fn names(&self) -> String {
        // As many names as a reader accepts in one message.
        const MOST: usize = 40;
        let all = self.columns.iter().map(|column| &column.name).chain(&self.unread);
        let mut names: Vec<String> = all.clone().take(MOST).map(|name| format!("`{name}`")).collect();
        if all.clone().count() > MOST {
            names.push(format!("{} more", all.count() - MOST));
        }
        names.join(", ")
    }

    pub(crate) fn column(&self, name: &str) -> Option<&Raw> {
        let exact = self.columns.iter().find(|column| column.name == name);
        exact.or_else(|| {
            let mut alike = self.columns.iter().filter(|column| column.name.eq_ignore_ascii_case(name));
            alike.next().filter(|_| alike.next().is_none())
        })
    }
}
