//! Runs `locate_picture`, `plan_and_simulate`, `own_task` and `own_rig` of `examples/` and checks their output;
//! `tests/student.rs` has the picture that `draw_principle` draws. `cargo test` builds the programs; after
//! `cargo build --examples` this test runs alone.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::env::consts::EXE_SUFFIX;
use std::process::Command;

/// Output of the example on stdout.
fn output_of(example: &str, args: &[&str]) -> String {
    let test = std::env::current_exe().unwrap();
    let program = test.ancestors().nth(2).unwrap().join("examples").join(format!("{example}{EXE_SUFFIX}"));
    assert!(program.is_file(), "{} is missing: `cargo build --examples` makes it", program.display());
    let output = Command::new(program).args(args).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
    let (stdout, stderr) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{example}: {stderr}{stdout}");
    stdout
}

/// All numbers in a line.
fn numbers(line: &str) -> Vec<f64> {
    let words = line.split(|c: char| c.is_whitespace() || c == ',');
    words.filter_map(|word| word.parse().ok()).collect()
}

#[test]
fn rendered_coins_are_all_located() {
    let printed = output_of("locate_picture", &[]);
    let compared = numbers(printed.lines().last().unwrap());
    let [found, of, worst_mm] = compared[..] else { panic!("{printed}") };
    assert!(found == of && of >= 1.0 && worst_mm < 0.2, "{printed}");
}

#[test]
fn coin_of_a_picture_file_is_located_without_a_truth() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("frame.png").display().to_string();
    let mut upm = std::process::Command::new(env!("CARGO_BIN_EXE_upm"));
    upm.args(["render", "configs/plus-sign.json", "--out", &picture]).current_dir(env!("CARGO_MANIFEST_DIR"));
    assert!(upm.output().unwrap().status.success());
    let printed = output_of("locate_picture", &[&picture]);
    assert_eq!(printed.lines().last(), Some("1 coins found"), "{printed}");
    assert!(printed.contains("penny at "), "{printed}");
}

#[test]
fn forecast_of_a_plan_is_near_the_truth() {
    let printed = output_of("plan_and_simulate", &[]);
    assert!(printed.starts_with("Solved: 1 motions for 3 coins"), "{printed}");
    let coins: Vec<Vec<f64>> = printed.lines().skip(2).map(numbers).collect();
    assert_eq!(coins.len(), 3, "{printed}");
    for coin in coins {
        let [_, wanted_x, wanted_y, .., true_x, true_y, off] = coin[..] else { panic!("{printed}") };
        let along = (wanted_x * true_x + wanted_y * true_y) / wanted_x.hypot(wanted_y);
        assert!(along > 0.5 * wanted_x.hypot(wanted_y), "each goes its own way: {printed}");
        assert!(off < 0.5, "{printed}");
    }
}

#[test]
fn custom_task_is_completed() {
    let printed = output_of("own_task", &[]);
    assert!(printed.starts_with("completed: 4 of 4 parts on the circle"), "{printed}");
    let radii_mm: Vec<f64> =
        printed.lines().filter(|line| line.contains("from the centre")).map(|line| numbers(line)[2]).collect();
    assert_eq!(radii_mm.len(), 4, "{printed}");
    assert!(radii_mm.iter().all(|radius_mm| (radius_mm - 60.0).abs() <= 0.6), "{printed}");
}

#[test]
fn wrapped_rig_logs_every_pulse() {
    let printed = output_of("own_rig", &[]);
    let logged = printed.lines().filter(|line| line.contains(" s  pulse ")).count();
    let last = numbers(printed.lines().last().unwrap());
    assert!(logged >= 2 && last[0] == logged as f64 && last[1] > last[0], "{printed}");
    assert!(printed.lines().any(|line| line.starts_with("completed: ")), "{printed}");
}
