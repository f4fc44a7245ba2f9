//! The first observation: locates the table without prior knowledge, waiting while a hand or darkness may hide it.

use std::time::Duration;

use super::scene::HAND_S;
use crate::RunIo;
use crate::findings::Findings;
use crate::guards::Guards;
use crate::run_end::{OrEnd, RunEnd, check_stop};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::signal::Frame;
use upm_perception::vision::{Table, locate_table};

/// Sampling points across the plate for the check of the exposure.
const ACROSS: usize = 24;
/// Distance from the plate's middle at which the ground beside it is sampled, in half sides.
const BESIDE: f64 = 1.06;

/// Captures frames until one shows the table. Returns the table and the time at which the search began.
pub(super) fn find_table(io: &mut RunIo<'_>, frame: &mut Frame, guards: &Guards) -> OrEnd<(Table, Duration)> {
    let mut why = String::new();
    let mut conditions = Findings::default();
    let since = io.rig.now();
    let gives_up = guards.has(Finding::TableMissing);
    while why.is_empty() || !gives_up || io.rig.now().secs_since(since) < HAND_S {
        check_stop(io.stop)?;
        io.rig.capture(frame)?;
        let started = io.clock.elapsed();
        match locate_table(frame, &io.model.lens, io.model.plate_side_m) {
            Ok(table) if !is_overexposed(frame, &table) => {
                conditions.end_run(frame.exposed_at, io.sink);
                return Ok((table, started));
            }
            Ok(_) => why = "the plate or the ground is overexposed".to_owned(),
            Err(fault) => why = fault.to_string(),
        }
        let reason = format!("no table in the camera's frames: {why}");
        conditions.note(frame.exposed_at, Finding::TableMissing, reason, io.sink);
        conditions.end_cycle(frame.exposed_at, io.sink);
    }
    Err(RunEnd::failed_because(Finding::TableMissing, format!("no table found in {HAND_S:.0} s: {why}")))
}

/// True when most of the plate, or of the ground beside it, is saturated: the plate's sides then appear up to half a
/// pixel too far out, or in.
fn is_overexposed(frame: &Frame, table: &Table) -> bool {
    let half_m = 0.5 * table.side_m;
    let steps = || (0..ACROSS).map(|i| (2.0 * (i as f64 + 0.5) / ACROSS as f64 - 1.0) * half_m);
    let plate = steps().flat_map(|x| steps().map(move |y| (x, y)));
    let out_m = BESIDE * half_m;
    let ground = steps().flat_map(|t| [(t, out_m), (t, -out_m), (out_m, t), (-out_m, t)]);
    is_mostly_white(frame, table, plate) || is_mostly_white(frame, table, ground)
}

fn is_mostly_white(frame: &Frame, table: &Table, places_m: impl Iterator<Item = (f64, f64)>) -> bool {
    let level = |(x, y): (f64, f64)| {
        let at = table.image_from_table(Vec2::new(x, y));
        let is_inside = at.x >= 0.0 && at.y >= 0.0 && at.x < frame.width as f64 && at.y < frame.height as f64;
        frame.pixels.get(at.y as usize * frame.width + at.x as usize).filter(|_| is_inside)
    };
    let levels: Vec<&u8> = places_m.filter_map(level).collect();
    2 * levels.iter().filter(|level| ***level == u8::MAX).count() > levels.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Lens;

    /// A square of 200 px in the middle of a picture of 300 px.
    fn pictured(plate: u8, ground: u8) -> (Frame, Table) {
        let mut frame = Frame::new(300, 300);
        for (i, pixel) in frame.pixels.iter_mut().enumerate() {
            let inside = |at: usize| (50..250).contains(&at);
            *pixel = if inside(i % 300) && inside(i / 300) { plate } else { ground };
        }
        let lens = Lens::ideal(1000.0, Vec2::repeat(149.5));
        let corners = [(49.5, 49.5), (249.5, 49.5), (249.5, 249.5), (49.5, 249.5)].map(|(x, y)| Vec2::new(x, y));
        (frame, Table::from_ideal_corners(corners, 0.2, &lens).unwrap())
    }

    #[test]
    fn white_plates_and_white_grounds_are_overexposed() {
        for (plate, ground, is_white) in
            [(225, 12, false), (254, 12, false), (255, 12, true), (40, 255, true), (40, 200, false)]
        {
            let (frame, table) = pictured(plate, ground);
            assert_eq!(is_overexposed(&frame, &table), is_white, "{plate} on {ground}");
        }
    }
}
