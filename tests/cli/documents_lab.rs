//! Figures of the lab on the pages, beside those in `documents.rs`: the array of resonators, the vision over many
//! scenes, and the rest of the feeder, of rock and of two parts.

use super::documents::Figures;
use super::page::FigurePage;

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
#[ignore = "campaign: `cargo test --test cli -- --ignored campaign_of` runs it"]
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
