//! Which settings are run: designs, plans, lists.

use rsm_sweep::table::{Cells, Table};
use rsm_sweep::{no_diagnosis, tasks};

use super::scenario;

fn table(text: &str) -> Table {
    let scenario = scenario(text);
    let tasks = tasks::list(&scenario).unwrap();
    let results: Vec<_> = tasks.iter().map(|task| Some(task.run(&scenario, 1, &no_diagnosis))).collect();
    Table::of(&scenario, &tasks, &results)
}

fn column(table: &Table, name: &str) -> Vec<f64> {
    table.numbers(name).unwrap().iter().map(|it| it.unwrap()).collect()
}

const HEAD: &str =
    "format = 1\nsweep = \"s\"\nplants = [\"axis.toml\"]\nrecords = [\"motion.csv\"]\noutputs.position = [\"final\"]\n";

fn vary(of: &str, rest: &str) -> String {
    format!("[[vary]]\nparameter = \"{of}\"\n{rest}\n")
}

#[test]
fn hypercube_and_sobol_have_one_run_in_each_slice() {
    for design in ["latin-hypercube", "sobol"] {
        let text = format!("{HEAD}design = \"{design}\"\nruns = 16\n")
            + &vary("mass", "distribution = \"uniform\"\nrange = [1.0, 17.0]")
            + &vary("force_gain", "distribution = \"uniform\"\nrange = [2.0, 18.0]");
        let table = table(&text);
        for (name, first) in [("mass", 1.0), ("force_gain", 2.0)] {
            let mut slices: Vec<usize> = column(&table, name).iter().map(|it| (it - first) as usize).collect();
            slices.sort_unstable();
            assert_eq!(slices, (0..16).collect::<Vec<_>>(), "{design}, {name}");
        }
    }
}

#[test]
fn a_full_factorial_has_every_combination_once() {
    let text = format!("{HEAD}design = \"full-factorial\"\n")
        + &vary("mass", "distribution = \"list\"\nvalues = [1.0, 2.0, 3.0]")
        + &vary("force_gain", "distribution = \"list\"\nvalues = [4.0, 5.0]");
    let table = table(&text);
    let mut found: Vec<(u64, u64)> =
        column(&table, "mass").iter().zip(column(&table, "force_gain")).map(|(a, b)| (*a as u64, b as u64)).collect();
    found.sort_unstable();
    assert_eq!(found, [(1, 4), (1, 5), (2, 4), (2, 5), (3, 4), (3, 5)]);
}

#[test]
fn a_plan_is_run_in_the_units_of_the_plant_and_the_rest_is_drawn() {
    let text = format!("{HEAD}plan = \"friction.csv\"\n")
        + &vary("mass", "distribution = \"plan\"")
        + &vary("viscous_friction", "distribution = \"plan\"\ncolumn = \"other\"")
        + &vary("force_gain", "distribution = \"normal\"\nrelative_sd = 0.01");
    let table = table(&text);
    assert_eq!(column(&table, "mass"), [1.8, 2.2]);
    assert_eq!(column(&table, "viscous_friction"), [1.0, 2.0]);
    let gains = column(&table, "force_gain");
    assert!(gains[0] != gains[1] && gains.iter().all(|it| (it - 4.0).abs() < 0.2), "{gains:?}");
}

#[test]
fn several_plants_and_records_are_a_task_each_and_the_table_says_which() {
    let text = HEAD
        .replace("[\"motion.csv\"]", "[\"motion.csv\", \"push.csv\"]")
        .replace("[\"axis.toml\"]", "[\"axis.toml\", \"light.toml\"]")
        + "runs = 2\n"
        + &vary("mass", "distribution = \"normal\"\nrelative_sd = 0.01");
    let table = table(&text);
    let names = |name: &str| match &table.column(name).unwrap().cells {
        Cells::Texts(cells) => cells.iter().map(|it| it.clone().unwrap()).collect::<Vec<_>>(),
        _ => panic!("{name} is text"),
    };
    assert_eq!(table.rows(), 8);
    assert_eq!(names("plant")[3..5], ["axis.toml", "light.toml"]);
    assert_eq!(names("record")[..4], ["motion.csv", "motion.csv", "push.csv", "push.csv"]);
    let masses = column(&table, "mass");
    // The same draws on both plants: 2 kg and 1 kg.
    assert_eq!(masses[..2], masses[2..4]);
    assert!((masses[0] / masses[4] - 2.0).abs() < 1e-12);
    assert!(table.csv().starts_with("run[1],plant,record,mass[kg],position_final[m],failed,task\n1,axis.toml,motion.csv,"));
}

#[cfg(feature = "parquet")]
#[test]
fn parquet_reads_back_to_the_table() {
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::RowAccessor as _;

    let text = format!("{HEAD}design = \"full-factorial\"\n")
        + &vary("mass", "distribution = \"list\"\nvalues = [1e-9, 0.5, 1.0, 2.0, 4.0]");
    let table = table(&text);
    let bytes = rsm_sweep::parquet::write(&table).unwrap();
    let mut file = tempfile::tempfile().unwrap();
    std::io::Write::write_all(&mut file, &bytes).unwrap();
    let reader = SerializedFileReader::new(file).unwrap();
    let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 5);
    let masses = column(&table, "mass");
    for (k, row) in rows.iter().enumerate() {
        assert_eq!((row.get_long(0).unwrap(), row.get_double(3).unwrap()), (k as i64 + 1, masses[k]));
        assert_eq!(row.get_string(1).unwrap(), "axis.toml");
        assert_eq!(row.get_double(4).ok(), table.numbers("position_final").unwrap()[k]);
    }
}

#[cfg(not(feature = "parquet"))]
#[test]
fn a_build_without_parquet_names_the_feature() {
    let text = format!("{HEAD}runs = 1\n") + &vary("mass", "distribution = \"tolerance\"");
    assert!(rsm_sweep::parquet::write(&table(&text)).unwrap_err().contains("--features parquet"));
}
