//! Figures of the experiments on the pages, compared with the output of the program, and the pictures of the student's
//! page. Figures that depend on the computer (times, speeds) are left out. `UPM_REMAKE_GOLDEN=1` writes them anew.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use std::process::Command;
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
        let mut command = Command::new(env!("CARGO_BIN_EXE_upm-lab"));
        command.current_dir(root()).args(args).args(["--json", "--out", out.path().to_str().unwrap()]);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        Self(serde_json::from_slice(&output.stdout).unwrap())
    }

    fn all(&self) -> impl Iterator<Item = &Value> {
        self.0["figures"].as_array().unwrap().iter()
    }

    /// `measured`, `reference` or `relative_error` of the figure called `name`.
    fn value(&self, name: &str, key: &str) -> f64 {
        let figure = self.all().find(|figure| figure["name"] == name).unwrap_or_else(|| panic!("no figure {name:?}"));
        figure[key].as_f64().unwrap()
    }

    /// Measured value of the figure called `name`.
    fn get(&self, name: &str) -> f64 {
        self.value(name, "measured")
    }

    /// Value in the experiment's table, row and column counted from 0.
    fn in_table(&self, row: usize, column: usize) -> f64 {
        self.0["table"]["rows"][row][column].as_f64().unwrap()
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
fn at_most(value: f64, decimals: i32) -> f64 {
    let scale = 10_f64.powi(decimals);
    (value * scale).ceil() / scale
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
        let mut command = Command::new(env!("CARGO_BIN_EXE_upm-lab"));
        assert!(command.current_dir(folder.path()).arg(experiment).output().unwrap().status.success());
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
    let steps = steering.range("step ");
    let mut page = FigurePage::open("docs/results.md");
    // 15 is the number of the equation
    page.passage("every centre within", "in (paper", &[steering.get("worst COR"), 15.0, steps[0], steps[1]]);
    let read = ["read-out inside, rms", "read-out outside, worst"].map(|name| map.get(name));
    page.passage("| inside", "% of distance at worst", &read);
    page.assert_as_measured();

    let mut page = FigurePage::open("docs/lab.md");
    let axes = ["axis y: step by 256 of X1 - X2", "axis x: step by 256 of Y2 - Y1"].map(|name| steering.get(name));
    page.passage("whole chain (Table 1) |", "in |", &steps);
    page.passage("| the two axes |", "in |", &axes);
    page.passage("not calibrated | ratio", "|", &[steering.get("axis y over axis x, X coils stronger")]);
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn read_out_of_pulses_has_the_figures_of_the_documents() {
    let weak = Figures::of(&["waveform-fit"]);
    let strong = Figures::of(&["waveform-fit", "--rig", "configs/rigs/upm-2.json"]);
    let largest = |part: &str, relative: bool| {
        [&weak, &strong].map(|figures| figures.largest_error(part, relative)).into_iter().fold(0.0, f64::max)
    };
    let natural = at_most(100.0 * largest("resonance: natural", true), 1);
    let damping = at_most(largest("resonance: damping", false), 3);
    let mut page = FigurePage::open("docs/results.md");
    page.passage("natural frequencies within", "of the rig file's", &[natural, damping]);
    page.assert_as_measured();
    assert!(weak.get("force signs wrong, of 10000") == 0.0 && largest("FFT amplitude at", true) < 5e-3);
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn forces_and_pulses_have_the_figures_of_the_documents() {
    let (force, law) = (Figures::of(&["force-curve"]), Figures::of(&["pulse-law"]));
    let mean = at_most(100.0 * force.get("relative deviation of the mean force, largest"), 1);
    let time = at_most(100.0 * force.value("time to 1 - 1/e of A/2", "relative_error").abs(), 2);
    let disc = at_most(100.0 * force.range("relative deviation of a disc's ")[1], 3);
    let mut page = FigurePage::open("docs/results.md");
    page.passage("of the belt's speed | within", "% of the closed form", &[mean, time]);
    page.passage("slip ratios | within", "% | same", &[disc]);
    page.assert_as_measured();

    let range = ["from", "up to"].map(|end| law.get(&format!("fast plate: within 10 % of that {end} S")));
    let mut page = FigurePage::open("docs/lab.md");
    page.passage("mean force on a part at rest |", "μ m g |", &[force.get("mean force on a part at rest, f0")]);
    page.passage("2 g, 60 Hz |", "ms |", &[force.get("initial time constant 1/k2")]);
    page.passage("(Figs. 8, 9) |", "m/s² |", &[law.get("fast plate: displacement over S², largest")]);
    page.passage("constant to 10 % |", "ms, all", &range);
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn coins_of_the_paper_have_the_figures_of_the_pages() {
    let (track, two) = (Figures::of(&["race-track"]), Figures::of(&["two-parts"]));
    let span = Figures::of(&["field-span"]);
    let arcs = ["inner", "middle", "outer"].map(|coin| track.get(&format!("{coin} coin: arc")));
    let dimensions = ["rigid rotations", "ideal fields"].map(|kind| span.get(&format!("dimensions, {kind}")));
    let fourth = ["ideal fields", "pulses of a fast plate", "long pulses of a slow plate"]
        .map(|kind| span.get(&format!("fourth singular value over the first, {kind}")));
    let misses = |of: &str| {
        ["1 observation", "2 observations", "4 observations", "8 observations"]
            .map(|count| two.get(&format!("E of {count}, {of}")))
    };
    let mut page = FigurePage::open("docs/lab.md");
    page.passage("one rotation field (Fig. 2) |", "mm |", &arcs);
    page.passage("rigid, ideal field |", "|", &dimensions);
    page.passage("long pulses of a slow one |", "|", &fourth);
    page.passage("ideal field (Fig. 3) |", "mm |", &misses("ideal field"));
    page.passage("on the plate of `upm-2` |", "mm |", &misses("rig's plate"));
    page.assert_as_measured();

    let mut page = FigurePage::open("docs/student.md");
    let [one, more @ ..] = misses("ideal field");
    page.passage("takes one large step of", ": while a coin goes", &[two.get("mean step of the parts"), one]);
    page.passage("miss falls to", ": the first halving", &more);
    page.assert_as_measured();
}

/// Header of the tables of feeder, topple, rock and array on the lab's page.
const MACHINES: &str = "| what | measured | paper";

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn feeder_and_ledges_have_the_figures_of_the_lab_page() {
    let (feeder, topple) = (Figures::of(&["feeder"]), Figures::of(&["topple"]));
    let slope = "slope of force over rate, K, at d = 0.548, ±15 dyn";
    let forced = [feeder.get(slope), feeder.get("force at rate zero, -K ν, at d = 0.548, ±15 dyn")];
    let get = |name: &str| topple.get(name);
    let least = topple.value("least speed that topples the part, simulated", "reference");
    let below = 100.0 * (1.0 - get("middle of these two") / least);
    let speeds = ["highest speed at which none fell", "lowest speed at which all fell"].map(get);
    let coefficients =
        ["ratio of the speeds of b x b(1 + δ): coefficient of δ", "the same: coefficient of δ²"].map(get);
    let flat = [
        "blocks 8 x 12 x 18 mm on their largest face at first",
        "the same after ledge 1 at 443 mm/s",
        "the same after ledge 2 at 412 mm/s",
    ]
    .map(|name| 100.0 * get(name));
    // the numbers of the paper and of its equations are as they stand
    let rows: [(&str, &str, &[f64]); 7] = [
        ("viscosity K", "measured", &forced),
        ("viscosity K", "paper", &[1.95, -4.72, 4.0, feeder.value(slope, "reference")]),
        ("our two harmonics", "measured", &[feeder.in_table(2, 3), feeder.in_table(2, 2)]),
        ("our two harmonics", "paper", &[feeder.in_table(0, 3), 2.0, feeder.in_table(1, 3), feeder.in_table(1, 0)]),
        ("critical speeds of a block", "measured", &[1.0, coefficients[0], coefficients[1]]),
        ("peg of", "measured", &[speeds[0], speeds[1], below, 2.3, get("their distance over their middle")]),
        ("blocks of", "measured", &flat),
    ];
    let mut page = FigurePage::open("docs/lab.md");
    for (label, column, measured) in rows {
        page.cell(MACHINES, label, column, measured);
    }
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn rocking_has_the_figures_of_the_lab_page() {
    let rock = Figures::of(&["rock"]);
    let get = |name: &str| rock.get(name);
    // the last figure of that name: the stroke on the path to toppling
    let strokes = rock.all().filter(|figure| figure["name"] == "stroke of the table for it");
    let stroke_mm = strokes.last().unwrap()["measured"].as_f64().unwrap();
    let [_, speed_mm_s] = rock.range("largest speed of the table for it");
    let high = ["first peak", "second peak", "lies flat after"].map(|what| get(&format!("start 6 % high: {what}")));
    let ramped = [get("ramped wave: start at 0.30 rad comes to"), 10.0, get("within 10 % of that after")];
    let apart = ["20 x 22 mm, standing: peak after the impact", "the same block, lying"].map(get);
    let mut page = FigurePage::open("docs/lab.md");
    page.cell(MACHINES, "square wave", "measured", &high);
    page.cell(MACHINES, "ramped wave", "measured", &ramped);
    page.cell(MACHINES, "20 × 22 mm", "measured", &apart);
    page.cell(MACHINES, "20 × 40 mm raised", "measured", &[stroke_mm, 1e-3 * speed_mm_s]);
    let impacts = get("impacts from 0.10 rad to toppling, 15 % a period");
    assert_eq!(impacts, 9.0, "docs/lab.md says that the block topples at the ninth impact");
    let kept = [[0, 5], [0, 6], [1, 5], [1, 6]].map(|[row, column]| rock.in_table(row, column));
    page.passage("the block of Fig. 8 back from", "; the drive of Fig. 6", &kept);
    page.assert_as_measured();
}

#[test]
#[ignore = "campaign: `cargo test -p upm-lab -- --ignored campaign_of` runs it"]
fn campaign_of_an_array_of_resonators_has_the_figures_of_the_lab_page() {
    let mchip = Figures::of(&["mchip"]);
    let get = |name: &str| mchip.get(name);
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
    page.passage("m = μ z/a:", "dyn at 55 µg", &[mchip.value("the same beside single bounces", "reference")]);
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
    let rate = |set: &[&str]| Figures::of(&[&["mchip"], set].concat()).get("feed rate");
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
        let get = |name: &str| vision.get(&format!("{family}: {name}"));
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
