//! Draws `assets/principle.svg`: one rotation beside one synthesised motion, both out of the shipped library of
//! `upm-2`.
//!
//! ```sh
//! cargo run --no-default-features --example draw_principle
//! ```
//!
//! Arrows are displacements by a single pulse, at the scale of the plate. On the left they were measured by calibration
//! for one entry of the library; on the right the planner searches one motion for six coins, and the displacements of
//! probe discs all over the plate are predicted for the same motion.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use upm::chart::Color;
use upm::cor_library::{Entry, Library};
use upm::geometry::Vec2;
use upm::planner::{FieldPlanner, PartState, PlannedPulse, PlannerParams};
use upm::units::{m_from_mm, mm_from_m};

/// Width of the picture and of each plate in it, px.
const WIDTH_PX: f64 = 800.0;
const PLATE_PX: f64 = 368.0;
/// Top edge of the plates and height of the picture, px.
const TOP_PX: f64 = 52.0;
const HEIGHT_PX: f64 = 480.0;
/// Number of arrows along a side of the plate.
const ARROWS: usize = 15;
/// Arrows shorter than this are not drawn, px.
const SHORTEST_PX: f64 = 1.0;
/// Line widths of the field's arrows and of the coins, px.
const THIN_PX: f64 = 1.1;
const THICK_PX: f64 = 2.4;

const PENNY_M: f64 = 9.525e-3;
/// Requested centre of rotation, mm: away from the middle of the plate.
const CENTER_MM: [f64; 2] = [-62.0, 38.0];
/// Sustain of the rotation's pulses, s, and the number of pulses played on the coins.
const SUSTAIN_S: f64 = 0.2;
const PULSES: usize = 4;
/// Coins on the left, mm.
const CARRIED_MM: [[f64; 2]; 4] = [[-72.0, -16.0], [30.0, 50.0], [-104.0, 92.0], [60.0, -110.0]];
/// Coins on the right, each with its wanted step, mm.
const STEERED_MM: [[[f64; 2]; 2]; 6] = [
    [[-96.0, 82.0], [22.0, 0.0]],
    [[4.0, 92.0], [0.0, -22.0]],
    [[92.0, 62.0], [-16.0, 16.0]],
    [[-92.0, -50.0], [0.0, 22.0]],
    [[6.0, -12.0], [-20.0, -8.0]],
    [[76.0, -92.0], [14.0, 16.0]],
];
/// Number of searches for a motion, each from other starting values; the one with the least error is drawn.
const SEARCHES: usize = 8;

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let library = Library::load(&root.join("assets/libraries/upm-2.json")).map_err(|faults| format!("{faults:?}"))?;
    std::fs::write(root.join("assets/principle.svg"), picture(&Arc::new(library))?)?;
    Ok(())
}

/// The whole picture as an SVG document.
pub fn picture(library: &Arc<Library>) -> Result<String, Box<dyn Error>> {
    let margin_px = (WIDTH_PX - 2.0 * PLATE_PX) / 3.0;
    let left = rotation(library)?.element(
        margin_px,
        ["One rotation: all along their tangents", "arrows: displacement by one pulse about the cross"],
    );
    let right = field(library)?.element(
        2.0 * margin_px + PLATE_PX,
        ["One synthesised motion: each its own way", "arrows: displacement of probe discs by one pulse"],
    );
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH_PX} {HEIGHT_PX}\" width=\"{WIDTH_PX}\" \
         height=\"{HEIGHT_PX}\" font-family=\"Helvetica, Arial, sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" rx=\"8\" fill=\"white\"/>\n{left}{right}</svg>\n"
    ))
}

/// PlateDrawing of the entry whose centre is nearest to the requested one, with coins moved by it.
fn rotation(library: &Library) -> Result<PlateDrawing, Box<dyn Error>> {
    let wanted_m = Vec2::from(CENTER_MM.map(m_from_mm));
    let fastest = library.entries.iter().map(|entry| entry.pump.spin_radps.abs()).fold(0.0, f64::max);
    let off_m = |entry: &Entry| entry.center_m().map_or(f64::INFINITY, |center_m| (center_m - wanted_m).norm());
    let strong = library.entries.iter().enumerate().filter(|(_, entry)| entry.pump.spin_radps.abs() > 0.3 * fastest);
    let (number, entry) = strong.min_by(|a, b| off_m(a.1).total_cmp(&off_m(b.1))).ok_or("no entry")?;
    let counter_clockwise = entry.pump.spin_radps.signum();
    let carried = |p: Vec2| p + library.displacement_at(number, p, SUSTAIN_S) * counter_clockwise;
    let mut panel = PlateDrawing::new(library);
    panel.arrows(panel.grid().map(|p| [p, carried(p)]), Color::Gray, THIN_PX);
    panel.cross(entry.center_m().ok_or("no centre")?);
    for (i, start_mm) in CARRIED_MM.into_iter().enumerate() {
        let places = std::iter::successors(Some(Vec2::from(start_mm.map(m_from_mm))), |&p| Some(carried(p)));
        panel.coin(i, &places.take(PULSES + 1).collect::<Vec<_>>());
    }
    Ok(panel)
}

/// PlateDrawing of one motion for all coins on the right: its forecast for them, and for probe discs on a grid.
fn field(library: &Arc<Library>) -> Result<PlateDrawing, Box<dyn Error>> {
    let params = PlannerParams {
        lever_arm_m: 0.1,
        half_side_m: 0.5 * library.plate_side_m,
        edge_margin_m: 1e-3,
        separation_m: 2e-3,
        min_distance_m: 0.2e-3,
        frame_s: 1.0 / 60.0,
        exposure_s: 2e-3,
        max_sustain_s: 0.3,
    };
    let mut planner = FieldPlanner::new(library, params).ok_or("the library has no fields")?;
    let coins = STEERED_MM.map(|[position, step]| part(position, step));
    let mut found = Vec::new();
    for _ in 0..SEARCHES {
        let plan = planner.plan(&coins, &[]);
        let (Some(PlannedPulse::Field(pulse)), Some(ends_m)) = (plan.pulses.first(), plan.predicted_m.first()) else {
            continue;
        };
        found.push((missed_m(&coins, ends_m), pulse.clone(), ends_m.clone()));
    }
    let (_, pulse, ends_m) = found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).ok_or("no motion found")?;
    let mut panel = PlateDrawing::new(library);
    let probes: Vec<PartState> = panel.grid().map(|p| part([p.x, p.y].map(mm_from_m), [0.0; 2])).collect();
    let carried = planner.forecast(&probes, &pulse);
    panel.arrows(probes.iter().zip(carried).map(|(probe, end_m)| [probe.position_m, end_m]), Color::Gray, THIN_PX);
    for (i, (coin, end_m)) in coins.iter().zip(ends_m).enumerate() {
        panel.coin(i, &[coin.position_m, end_m]);
    }
    Ok(panel)
}

/// Error of the steps: root of the sum of squares, m.
fn missed_m(coins: &[PartState], ends_m: &[Vec2]) -> f64 {
    let left = coins.iter().zip(ends_m).map(|(coin, end_m)| coin.position_m + coin.step_m - end_m);
    left.map(|left| left.norm_squared()).sum::<f64>().sqrt()
}

fn part(position_mm: [f64; 2], step_mm: [f64; 2]) -> PartState {
    let [position_m, step_m] = [position_mm, step_mm].map(|v| Vec2::from(v.map(m_from_mm)));
    PartState { position_m, step_m, radius_m: PENNY_M, gain: 1.0 }
}

/// A plate from above as elements of an SVG document; positions are px from its upper left corner.
struct PlateDrawing {
    half_side_m: f64,
    drawn: String,
}

impl PlateDrawing {
    fn new(library: &Library) -> Self {
        Self { half_side_m: 0.5 * library.plate_side_m, drawn: String::new() }
    }

    fn px_per_m(&self) -> f64 {
        PLATE_PX / (2.0 * self.half_side_m)
    }

    fn px(&self, p: Vec2) -> [f64; 2] {
        [self.half_side_m + p.x, self.half_side_m - p.y].map(|along_m| along_m * self.px_per_m())
    }

    /// Positions of the arrows, half a pitch inside the edge.
    fn grid(&self) -> impl Iterator<Item = Vec2> + use<> {
        let half_side_m = self.half_side_m;
        let at = move |i: usize| half_side_m * ((2 * i + 1) as f64 / ARROWS as f64 - 1.0);
        (0..ARROWS * ARROWS).map(move |i| Vec2::new(at(i % ARROWS), at(i / ARROWS)))
    }

    fn put(&mut self, element: &str) {
        self.drawn += element;
        self.drawn.push('\n');
    }

    /// An arrow for each displacement; those that leave the plate are clipped with the panel.
    fn arrows(&mut self, ways: impl IntoIterator<Item = [Vec2; 2]>, color: Color, width_px: f64) {
        let (mut shafts, mut heads) = (String::new(), String::new());
        for [from_m, to_m] in ways {
            let ([x, y], [to_x, to_y]) = (self.px(from_m), self.px(to_m));
            let (along_x, along_y) = (to_x - x, to_y - y);
            let length = (along_x * along_x + along_y * along_y).sqrt();
            if length < SHORTEST_PX {
                continue;
            }
            let head = (3.0 + 2.2 * width_px).min(0.55 * length) / length;
            let (neck_x, neck_y) = (to_x - head * along_x, to_y - head * along_y);
            let (wing_x, wing_y) = (-0.42 * head * along_y, 0.42 * head * along_x);
            shafts += &format!("M{x:.1} {y:.1}L{neck_x:.1} {neck_y:.1}");
            heads += &format!(
                "M{to_x:.1} {to_y:.1}L{:.1} {:.1}L{:.1} {:.1}Z",
                neck_x + wing_x,
                neck_y + wing_y,
                neck_x - wing_x,
                neck_y - wing_y
            );
        }
        let paint = hex(color);
        self.put(&format!(
            "<path d=\"{shafts}\" stroke=\"{paint}\" stroke-width=\"{width_px}\"/><path d=\"{heads}\" fill=\"{paint}\"/>"
        ));
    }

    fn cross(&mut self, at_m: Vec2) {
        let ([x, y], red) = (self.px(at_m), hex(Color::Red));
        let (left, top) = (x - 9.0, y - 9.0);
        self.put(&format!(
            "<path d=\"M{left:.1} {y:.1}h18M{x:.1} {top:.1}v18\" stroke=\"{red}\" stroke-width=\"3.5\"/>"
        ));
    }

    /// A coin at its start (dashed), its path, and at its end (filled).
    fn coin(&mut self, i: usize, places_m: &[Vec2]) {
        let (Some(&start_m), Some(&end_m)) = (places_m.first(), places_m.last()) else { return };
        let (radius, paint) = (PENNY_M * self.px_per_m(), hex(Color::nth(i)));
        let ([x, y], [end_x, end_y]) = (self.px(start_m), self.px(end_m));
        self.put(&format!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\" fill=\"white\" fill-opacity=\"0.85\" stroke=\"{paint}\" \
             stroke-width=\"1.5\" stroke-dasharray=\"3 2\"/>\
             <circle cx=\"{end_x:.1}\" cy=\"{end_y:.1}\" r=\"{radius:.1}\" fill=\"{paint}\" fill-opacity=\"0.4\" \
             stroke=\"{paint}\" stroke-width=\"1.5\"/>"
        ));
        self.arrows(places_m.windows(2).map(|way| [way[0], way[1]]), Color::nth(i), THICK_PX);
    }

    /// The finished panel with its left edge at `left_px`, a title above and a caption below, clipped by the inner
    /// element.
    fn element(&self, left_px: f64, [title, caption]: [&str; 2]) -> String {
        let (middle, below) = (left_px + 0.5 * PLATE_PX, TOP_PX + PLATE_PX + 26.0);
        format!(
            "<text x=\"{middle:.1}\" y=\"34\" font-size=\"17\" text-anchor=\"middle\" fill=\"#222\">{title}</text>\n\
             <svg x=\"{left_px:.1}\" y=\"{TOP_PX}\" width=\"{PLATE_PX}\" height=\"{PLATE_PX}\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#fafafa\"/>\n{}</svg>\n\
             <rect x=\"{left_px:.1}\" y=\"{TOP_PX}\" width=\"{PLATE_PX}\" height=\"{PLATE_PX}\" fill=\"none\" \
             stroke=\"#555\" stroke-width=\"1.5\"/>\n\
             <text x=\"{middle:.1}\" y=\"{below:.1}\" font-size=\"14\" text-anchor=\"middle\" fill=\"#555\">{caption}</text>\n",
            self.drawn
        )
    }
}

fn hex(color: Color) -> String {
    let [r, g, b] = color.rgb();
    format!("#{r:02x}{g:02x}{b:02x}")
}
