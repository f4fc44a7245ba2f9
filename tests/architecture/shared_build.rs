//! Tests use the libraries that the program was built with: of the README's two commands, the second compiles none of
//! them again.

use std::collections::BTreeSet;
use std::process::Command;

use super::{none, root};

/// A crate's name and version, then its path and features.
type Unit = (String, String);

/// The crates that `cargo` builds for these packages, with the features of each.
fn units(selection: &[&str]) -> BTreeSet<Unit> {
    let tree = ["tree", "--offline", "--locked", "--prefix", "none", "--format", "{p} {f}"];
    let output = Command::new(env!("CARGO")).args(tree).args(selection).current_dir(root()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let line = |line: &str| {
        // the mark of a crate whose dependencies were listed before
        let line = line.trim_end_matches(" (*)");
        let (name, rest) = line.split_once(' ')?;
        let (version, features) = rest.split_once(' ').unwrap_or((rest, ""));
        Some((format!("{name} {version}"), features.trim().to_owned()))
    };
    String::from_utf8(output.stdout).unwrap().lines().filter_map(line).collect()
}

/// Crates of the program that tests ask for more features of: compiled anew, with all that depends on them.
fn compiled_twice(program: &BTreeSet<Unit>, tests: &BTreeSet<Unit>) -> Vec<String> {
    let names: BTreeSet<&String> = program.iter().map(|(name, _)| name).collect();
    let twice = tests.difference(program).filter(|(name, _)| names.contains(name));
    twice.map(|(name, features)| format!("{name} is built again for tests, with the features {features}")).collect()
}

#[test]
fn tests_compile_no_library_of_the_program_again() {
    let (program, tests) = (units(&["--package", "upm", "--edges", "no-dev"]), units(&["--workspace"]));
    assert!(program.len() > 100 && program.len() < tests.len(), "{} and {}", program.len(), tests.len());
    none(compiled_twice(&program, &tests));
}

#[test]
fn further_features_are_found() {
    let units = |list: &[(&str, &str)]| list.iter().map(|(name, f)| ((*name).into(), (*f).into())).collect();
    let program = units(&[("a v1.0.0", "std"), ("b v1.0.0", "")]);
    let tests = units(&[("a v1.0.0", "alloc,std"), ("b v1.0.0", ""), ("only-tests v1.0.0", "std")]);
    let again = compiled_twice(&program, &tests);
    assert_eq!(again, ["a v1.0.0 is built again for tests, with the features alloc,std"]);
}
