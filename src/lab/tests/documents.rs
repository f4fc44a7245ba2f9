//! Figures of the experiments on the pages, compared with the output of the program, and the pictures of the student's
//! page. Figures that depend on the computer (times, speeds) are left out. `UPM_REMAKE_GOLDEN=1` writes them anew.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

#[path = "../../../tests/figures/page.rs"]
#[allow(dead_code)] // samples of output
mod page;

use page::FigurePage;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Figures of an experiment of the lab by name.
struct Figures(Value);

impl Figures {
    /// Runs `upm-lab` with these arguments.
    fn of(args: &[&str]) -> Self {
        let out = TempDir::new().unwrap();
        let mut command = Command::cargo_bin("upm-lab").unwrap();
        command.current_dir(root()).args(args).args(["--json", "--out", out.path().to_str().unwrap()]);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        Self(serde_json::from_slice(&output.stdout).unwrap())
    }

    /// Measured value of the figure called `name`, in `unit`.
    fn get(&self, name: &str, unit: f64) -> f64 {
        let figure = self.all().find(|figure| figure["name"] == name).unwrap_or_else(|| panic!("no figure {name:?}"));
        let value = figure["measured"].as_f64().unwrap() / unit;
        // avoids -0.0
        if value == 0.0 { 0.0 } else { value }
    }

    /// `|measured - reference|` of that figure, relative to the reference.
    fn error(&self, name: &str) -> f64 {
        let figure = self.all().find(|figure| figure["name"] == name).unwrap_or_else(|| panic!("no figure {name:?}"));
        figure["relative_error"].as_f64().unwrap().abs()
    }

    /// Reference value of the figure called `name`.
    fn reference(&self, name: &str) -> f64 {
        let figure = self.all().find(|figure| figure["name"] == name).unwrap_or_else(|| panic!("no figure {name:?}"));
        figure["reference"].as_f64().unwrap()
    }

    /// Value in the experiment's table, row and column counted from 0.
    fn in_table(&self, row: usize, column: usize) -> f64 {
        self.0["table"]["rows"][row][column].as_f64().unwrap()
    }

    fn all(&self) -> impl Iterator<Item = &Value> {
        self.0["figures"].as_array().unwrap().iter()
    }

    /// Least and largest measured value of the figures whose names begin with `begin`.
    fn range(&self, begin: &str) -> [f64; 2] {
        let named = self.all().filter(|figure| figure["name"].as_str().unwrap().starts_with(begin));
        let values = named.map(|figure| figure["measured"].as_f64().unwrap());
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
    }

    /// Largest `|measured - reference|` of the figures whose names contain `part`; relative to the reference if
    /// `relative`.
    fn largest_error(&self, part: &str, relative: bool) -> f64 {
        let named = self.all().filter(|figure| figure["name"].as_str().unwrap().contains(part));
        let errors = named.filter_map(|figure| {
            let (measured, reference) = (figure["measured"].as_f64()?, figure["reference"].as_f64()?);
            Some((measured - reference).abs() / if relative { reference } else { 1.0 })
        });
        errors.fold(0.0, f64::max)
    }
}

/// Least number with this many decimals that is not below `value`.
fn at_most(value: f64, decimals: usize) -> String {
    let scale = 10_f64.powi(decimals as i32);
    format!("{:.decimals$}", (value * scale).ceil() / scale)
}

/// Asserts that the document contains each of these passages; reports all that are missing.
fn assert_says(document: &str, passages: &[String]) {
    let text = fs::read_to_string(root().join(document)).unwrap();
    let lacking: Vec<&String> = passages.iter().filter(|passage| !text.contains(passage.as_str())).collect();
    assert!(lacking.is_empty(), "{document} does not say what the program measures:\n{lacking:#?}");
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn pictures_of_the_student_page_are_those_that_the_program_draws() {
    let folder = TempDir::new().unwrap();
    let drawn = [
        ("force-curve", &["force-curve"][..]),
        ("pulse-law", &["pulse-law-wave", "pulse-law-slow-plate"]),
        ("race-track", &["race-track"]),
        ("two-parts", &["two-parts-ideal"]),
    ];
    for (experiment, pictures) in drawn {
        Command::cargo_bin("upm-lab").unwrap().current_dir(folder.path()).arg(experiment).assert().success();
        for picture in pictures {
            let shipped = root().join(format!("assets/student/{picture}.svg"));
            let drawn = fs::read_to_string(folder.path().join(format!("runs/lab/{picture}.svg"))).unwrap();
            if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
                fs::write(&shipped, &drawn).unwrap();
            }
            assert!(drawn.len() < 60_000, "{picture}: {} bytes", drawn.len());
            assert!(fs::read_to_string(shipped).unwrap() == drawn, "{picture} is drawn differently now");
        }
    }
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn centres_of_rotation_have_the_figures_of_the_documents() {
    let (steering, map) = (Figures::of(&["cor-steering"]), Figures::of(&["cor-map"]));
    let [low, high] = steering.range("step ");
    let inside_mm = map.get("read-out inside, rms", 1.0);
    assert_says(
        "docs/results.md",
        &[
            format!(
                "every centre within {:.3} in of Eq. 15, steps {low:.2} to {high:.2} in (paper: 2.48 to 3.14)",
                steering.get("worst COR", 1.0)
            ),
            format!(
                "inside {inside_mm:.2} mm rms, outside {:.1} % of distance at worst",
                map.get("read-out outside, worst", 1.0)
            ),
        ],
    );
    let axis = |name: &str| steering.get(name, 1.0);
    assert_says(
        "docs/lab.md",
        &[
            format!("| {low:.2} to {high:.2} in | 2.48 to 3.14 in; Eq. 15: 2.67 |"),
            format!(
                "| the two axes | {:.2} and {:.2} in |",
                axis("axis y: step by 256 of X1 - X2"),
                axis("axis x: step by 256 of Y2 - Y1")
            ),
            format!("| ratio {:.2} | ratio 1.12 |", axis("axis y over axis x, X coils stronger")),
        ],
    );
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn read_out_of_pulses_has_the_figures_of_the_documents() {
    let weak = Figures::of(&["waveform-fit"]);
    let strong = Figures::of(&["waveform-fit", "--rig", "configs/rigs/upm-2.json"]);
    let rigs = [&weak, &strong];
    let largest = |part: &str, relative: bool| {
        rigs.iter().map(|figures| figures.largest_error(part, relative)).fold(0.0, f64::max)
    };
    let wrong = weak.get("force signs wrong, of 10000", 1.0);
    assert_says(
        "docs/results.md",
        &[
            format!(
                "natural frequencies within {} %, damping ratios within {} of the rig file's",
                at_most(100.0 * largest("resonance: natural", true), 1),
                at_most(largest("resonance: damping", false), 3)
            ),
            format!("within {} % on every channel", at_most(100.0 * largest("FFT amplitude at", true), 1)),
            format!("| {wrong:.0} wrong | `upm-lab waveform-fit` |"),
        ],
    );
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn forces_and_pulses_have_the_figures_of_the_documents() {
    let (force, law) = (Figures::of(&["force-curve"]), Figures::of(&["pulse-law"]));
    let disc = force.range("relative deviation of a disc's ")[1];
    assert_says(
        "docs/results.md",
        &[
            format!(
                "| within {} %; within {} % of the closed form |",
                at_most(100.0 * force.get("relative deviation of the mean force, largest", 1.0), 1),
                at_most(100.0 * force.error("time to 1 - 1/e of A/2"), 2)
            ),
            format!("| within {} % | same |", at_most(100.0 * disc, 3)),
        ],
    );
    let [low, high] = ["from", "up to"].map(|end| law.get(&format!("fast plate: within 10 % of that {end} S"), 1.0));
    let over_square = law.get("fast plate: displacement over S², largest", 1.0);
    assert_says(
        "docs/lab.md",
        &[
            format!("| {:.4} μ m g | 0.24 (closed form 0.2386) |", force.get("mean force on a part at rest, f0", 1.0)),
            format!("| {:.1} ms | the paper prints 35", force.get("initial time constant 1/k2", 1.0)),
            format!("| {over_square:.3} m/s² | ½ f0 (1 + f0) μ g = 0.435 m/s² |"),
            format!("| {low:.0} to {high:.0} ms, all | proportional to S² |"),
        ],
    );
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn coins_of_the_paper_have_the_figures_of_the_lab_page() {
    let (track, two) = (Figures::of(&["race-track"]), Figures::of(&["two-parts"]));
    let arc = |coin: &str| track.get(&format!("{coin} coin: arc"), 1.0);
    let span = Figures::of(&["field-span"]);
    let dimensions = |kind: &str| span.get(&format!("dimensions, {kind}"), 1.0);
    let fourth = ["ideal fields", "pulses of a fast plate", "long pulses of a slow plate"]
        .map(|kind| span.get(&format!("fourth singular value over the first, {kind}"), 1.0));
    let own = ["1 observation", "2 observations", "4 observations", "8 observations"]
        .map(|count| two.get(&format!("E of {count}, rig's plate"), 1.0));
    let [two_observations, four, eight] =
        [2, 4, 8].map(|count| two.get(&format!("E of {count} observations, ideal field"), 1.0));
    assert_says(
        "docs/lab.md",
        &[
            format!("| {:.0}, {:.0}, {:.0} mm | equal in the ideal field |", arc("inner"), arc("middle"), arc("outer")),
            format!("| {}, {} | 3, as many as centres |", dimensions("rigid rotations"), dimensions("ideal fields")),
            format!("| {:.2}, {:.2}, {:.2} | 0 when rigid |", fourth[0], fourth[1], fourth[2]),
            format!("| {:.1}, {:.1}, {:.1}, {:.1} mm | |", own[0], own[1], own[2], own[3]),
            format!(
                "| {:.1}, {two_observations:.1}, {four:.1}, {eight:.1} mm | no figure printed",
                two.get("E of 1 observation, ideal field", 1.0)
            ),
        ],
    );
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn other_machines_have_the_figures_of_the_lab_page() {
    let (feeder, topple, rock) = (Figures::of(&["feeder"]), Figures::of(&["topple"]), Figures::of(&["rock"]));
    let slope = feeder.get("slope of force over rate, K, at d = 0.548, ±15 dyn", 1.0);
    let at_rest = feeder.get("force at rate zero, -K ν, at d = 0.548, ±15 dyn", 1.0);
    let ratio = "ratio of the speeds of b x b(1 + δ): coefficient of δ";
    let peg = |name: &str| topple.get(name, 1.0);
    let blocks = |after: &str| (peg(after) * 100.0).round();
    let rocked = |name: &str| rock.get(name, 1.0);
    // the last figure of that name: the stroke on the path to toppling
    let strokes = rock.all().filter(|figure| figure["name"] == "stroke of the table for it");
    let stroke_mm = strokes.last().unwrap()["measured"].as_f64().unwrap();
    let [_, speed_mps] = rock.range("largest speed of the table for it").map(|speed_mm_s| 1e-3 * speed_mm_s);
    assert_says(
        "docs/lab.md",
        &[
            format!("| {slope:.3} dyn s/cm, {at_rest:.3} dyn |"),
            format!("| {:.2} cm/s with a stroke of ", feeder.get("rate of the two harmonics cos wt - ½ cos 2wt", 1.0)),
            format!("| 1 + {:.3} δ + {:.3} δ² |", peg(ratio), peg("the same: coefficient of δ²")),
            format!(
                "| none fall at {:.1} mm/s, all at {:.1}; the middle {:.2} % below Eq. 2.3, band {:.1} % |",
                peg("highest speed at which none fell"),
                peg("lowest speed at which all fell"),
                100.0
                    * (1.0
                        - peg("middle of these two")
                            / topple.reference("least speed that topples the part, simulated")),
                peg("their distance over their middle")
            ),
            format!(
                "| {:.0} %, {:.0} %, {:.0} % | a cascade orients a batch |",
                blocks("blocks 8 x 12 x 18 mm on their largest face at first"),
                blocks("the same after ledge 1 at 443 mm/s"),
                blocks("the same after ledge 2 at 412 mm/s")
            ),
            format!(
                "| first peak {:.3} of the level, second {:.3}, flat after {:.2} s |",
                rocked("start 6 % high: first peak"),
                rocked("start 6 % high: second peak"),
                rocked("start 6 % high: lies flat after")
            ),
            format!(
                "| {:.3} rad, within 10 % of it after {:.2} s |",
                rocked("ramped wave: start at 0.30 rad comes to"),
                rocked("within 10 % of that after")
            ),
            format!(
                "| {:.3} and {:.3} rad after the impact |",
                rocked("20 x 22 mm, standing: peak after the impact"),
                rocked("the same block, lying")
            ),
            format!("table's stroke {stroke_mm:.0} mm, speed up to {speed_mps:.2} m/s |"),
        ],
    );
}

/// Header of the tables of feeder, topple, rock and array on the lab's page.
const MACHINES: &str = "| what | measured | paper";

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn feeder_has_the_other_figures_of_the_lab_page() {
    let feeder = Figures::of(&["feeder"]);
    let viscosity = feeder.reference("slope of force over rate, K, at d = 0.548, ±15 dyn");
    let mut page = FigurePage::open("docs/lab.md");
    let rows: [(&str, &str, &[f64]); 3] = [
        // the numbers of the paper and of its equations are as they stand
        ("viscosity K", "paper", &[1.95, -4.72, 4.0, viscosity]),
        ("our two harmonics", "measured", &[feeder.in_table(2, 3), feeder.in_table(2, 2)]),
        ("our two harmonics", "paper", &[feeder.in_table(0, 3), 2.0, feeder.in_table(1, 3), feeder.in_table(1, 0)]),
    ];
    for (label, column, measured) in rows {
        page.cell(MACHINES, label, column, measured);
    }
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn rocking_has_the_other_figures_of_the_lab_page() {
    let rock = Figures::of(&["rock"]);
    let get = |name: &str| rock.get(name, 1.0);
    let mut page = FigurePage::open("docs/lab.md");
    let impacts = get("impacts from 0.10 rad to toppling, 15 % a period");
    assert_eq!(impacts, 9.0, "docs/lab.md says that the block topples at the ninth impact");

    let kept = [[0, 5], [0, 6], [1, 5], [1, 6]].map(|[row, column]| rock.in_table(row, column));
    page.passage("the block of Fig. 8 back from", "; the drive of Fig. 6", &kept);
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn two_parts_have_the_figures_of_the_student_page() {
    let two = Figures::of(&["two-parts"]);
    let mut page = FigurePage::open("docs/student.md");
    let one_observation = two.get("E of 1 observation, ideal field", 1.0);
    page.passage(
        "takes one large step of",
        ": while a coin goes",
        &[two.get("mean step of the parts", 1.0), one_observation],
    );
    let more_observations = [2, 4, 8].map(|count| two.get(&format!("E of {count} observations, ideal field"), 1.0));
    page.passage("miss falls to", ": the first halving", &more_observations);
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn array_of_resonators_has_the_figures_of_the_lab_page() {
    let mchip = Figures::of(&["mchip"]);
    let get = |name: &str| mchip.get(name, 1.0);
    let percent = |name: &str| 100.0 * get(name);
    let ten = 10.0;
    let heavy = |force: &str| get(&format!("rate at {force} dyn, 207 µg"));
    let rows: [(&str, &[f64]); 10] = [
        ("every row alike", &[get("50 % duty: rate while it moves"), get("starts that jam within 1 s, of ten"), ten]),
        (
            "strobed, λ = 4, γ = 50",
            &[
                get("strobed, λ = 4, γ = 50: rate"),
                get("strobed: starts that jam, of ten"),
                ten,
                get("strobed: longest stop"),
            ],
        ),
        ("strobed: γ with the highest rate", &[get("strobed: γ with the highest rate, of 20 to 100")]),
        ("36 % duty: rate while it moves", &[get("36 % duty: rate while it moves")]),
        ("36 % duty: gain of rate", &["gain of rate by 36 % duty while it moves", "the same, strobed"].map(get)),
        ("ridge distance with the highest rate", &[get("ridge distance with the highest rate")]),
        ("ridge of 16 µm", &[get("rate at a ridge of 16 µm over that at 12 µm")]),
        (
            "strongest line of the part's height on soft rods",
            &["soft rods: line of the bouncing", "soft rods: the first over the second"].map(get),
        ),
        (
            "55 µg: slope",
            &["slope of the rate over force, 36 % duty", "opposing force that stops it", "rate at -0.05 dyn"].map(get),
        ),
        ("207 µg: rates", &["0", "-0.025", "-0.05", "-0.06", "-0.075", "-0.1"].map(heavy)),
    ];
    let mut page = FigurePage::open("docs/lab.md");
    for (label, measured) in rows {
        page.cell(MACHINES, label, "measured", measured);
    }
    page.passage("the part runs away at", "mm/s", &[get("rate with algebraic impacts")]);
    page.passage("m = μ z/a:", "dyn at 55 µg", &[mchip.reference("the same beside single bounces")]);
    page.passage("here the part rides at", "µm.", &[get("strobed: height above rest")]);
    page.assert_as_measured();
    for (said, is_so) in [
        ("36 % duty has no double bounces", percent("36 % duty: double bounces, of all contacts") < 0.5),
        ("no start jams on soft rods", get("soft rods: starts that jam, of three") == 0.0),
    ] {
        assert!(is_so, "docs/lab.md says: {said}");
    }
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn solid_slabs_have_the_figures_of_the_lab_page() {
    let rate = |set: &[&str]| Figures::of(&[&["mchip"], set].concat()).get("feed rate", 1.0);
    let solid = ["--set", "solidity=1", "--set", "natural_hz=8500"];
    let rates = [rate(&solid), rate(&[&solid[..], &["--set", "duty=0.36"]].concat())];
    let mut page = FigurePage::open("docs/lab.md");
    page.passage("of the paper,", "mm/s, and nothing jams", &rates);
    page.assert_as_measured();
}

/// Searches as many scenes as the command in the table says.
#[test]
#[ignore = "campaign: `cargo test -p upm-lab -- --ignored campaign_of` runs it"]
fn campaign_of_many_scenes_has_the_figures_of_the_results_page() {
    const VISION: &str = "| what | clean | rough | hard | command |";
    let mut page = FigurePage::open("docs/results.md");
    let row = page.row(VISION, "centre of a part");
    let (_, scenes) = row.cell("command").trim_matches('`').split_once("--scenes ").unwrap();
    let vision = Figures::of(&["vision", "--scenes", scenes]);
    let mut parts = Vec::new();
    for family in ["clean", "rough", "hard"] {
        let get = |name: &str| vision.get(&format!("{family}: {name}"), 1.0);
        for (label, name) in [
            ("centre of a part", "centre rms"),
            ("corner of the table", "corner rms"),
            ("position on the plate", "position rms"),
        ] {
            page.cell(VISION, label, family, &[get(name)]);
        }
        let faults = ["tables not found", "tables misplaced", "parts missed", "parts invented", "parts misnamed"];
        page.cell(VISION, "parts missed, invented, misnamed", family, &[faults.map(get).into_iter().sum::<f64>()]);
        parts.push(get("parts in all") / scenes.parse::<f64>().unwrap());
    }
    parts.sort_by(f64::total_cmp);
    page.passage("scenes of each family with", "parts on average", &[parts[0], parts[2]]);
    page.assert_as_measured();
}
