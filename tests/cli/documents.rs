//! Checks sample output and figures in README.md and docs against the output of the program. Commands whose figures
//! depend on the computer (times, speeds) are left out.

use std::fs;

use serde_json::Value;
use tempfile::TempDir;

use super::{root, status};

/// Figures of an experiment of the lab by name.
pub(super) struct Figures(Value);

impl Figures {
    /// Runs `upm lab` with these arguments.
    pub(super) fn of(args: &[&str]) -> Self {
        let out = TempDir::new().unwrap();
        let args = [&["lab", "--json", "--out", out.path().to_str().unwrap()], args].concat();
        Self(serde_json::from_str(&status(&args, 0).0).unwrap())
    }

    /// Measured value of the figure called `name`, in `unit`.
    pub(super) fn get(&self, name: &str, unit: f64) -> f64 {
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
    pub(super) fn reference(&self, name: &str) -> f64 {
        let figure = self.all().find(|figure| figure["name"] == name).unwrap_or_else(|| panic!("no figure {name:?}"));
        figure["reference"].as_f64().unwrap()
    }

    /// Value in the experiment's table, row and column counted from 0.
    pub(super) fn in_table(&self, row: usize, column: usize) -> f64 {
        self.0["table"]["rows"][row][column].as_f64().unwrap()
    }

    fn all(&self) -> impl Iterator<Item = &Value> {
        self.0["figures"].as_array().unwrap().iter()
    }

    /// Least and largest measured value of the figures whose names begin with `begin`.
    pub(super) fn range(&self, begin: &str) -> [f64; 2] {
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

fn text_of(document: &str) -> String {
    fs::read_to_string(root().join(document)).unwrap()
}

/// Asserts that the document contains each of these passages; reports all that are missing.
fn assert_says(document: &str, passages: &[String]) {
    let text = text_of(document);
    let lacking: Vec<&String> = passages.iter().filter(|passage| !text.contains(passage.as_str())).collect();
    assert!(lacking.is_empty(), "{document} does not say what the program measures:\n{lacking:#?}");
}

/// `line` without the wall times.
fn timeless(line: &str) -> &str {
    line.split_once(", run in ").map_or(line, |(before, _)| before)
}

#[test]
fn readme_sample_equals_the_printed_run() {
    let readme = text_of("README.md");
    let sample = readme.split_once("```text\n").unwrap().1.split_once("```").unwrap().0;
    let out = TempDir::new().unwrap();
    let args = ["run", "configs/plus-sign.json", "--quiet", "--rerun", "off", "--out", out.path().to_str().unwrap()];
    let (stdout, _) = status(&args, 0);
    // the name of the run folder contains the time
    let printed = stdout.lines().filter(|line| !line.trim_start().starts_with("run folder "));
    let (printed, sample): (Vec<&str>, Vec<&str>) =
        (printed.map(timeless).collect(), sample.lines().map(timeless).collect());
    assert_eq!(sample, printed);
}

#[test]
fn run_of_the_strong_rig_has_the_figures_of_the_documents() {
    let out = TempDir::new().unwrap();
    let out = out.path().to_str().unwrap();
    let args = ["run", "configs/plus-sign-upm-2.json", "--quiet", "--json", "--rerun", "off", "--out", out];
    let report: Value = serde_json::from_str(&status(&args, 0).0).unwrap();
    let [track_mm, time_s] = ["cross_track_rms_mm", "plate_time_s"].map(|key| report[key].as_f64().unwrap());
    let row =
        format!("| `upm-2`, plus-sign, one lap | {track_mm:.2} mm rms cross-track in {time_s:.0} s of plate time |");
    assert_says("docs/results.md", &[row]);
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
            format!("| {wrong:.0} wrong | `upm lab waveform-fit` |"),
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
