use rerun::{Ellipses2D, LineStrips2D, Points2D};

use super::camera::outline_px;
use super::paint::{self, in_frame, in_half_frame};
use super::picture::{self, pooled};
use super::recorder::{Logged, Tape};
use super::sink::RunContext;
use crate::geometry::Vec2;
use crate::recording::records::LocalisedRecord;
use crate::vision::{Detection, HoughArray, Plane, Stages};

/// The map of votes is shrunk to no more than this, px: its peaks are small, and the view is wide.
const VOTES_PX: [usize; 2] = [720, 410];

/// How table and parts were found: the frame at full size, edges, Hough votes and disk response, each with what was
/// read off it.
pub(super) fn log(tape: &Tape, found: &LocalisedRecord, context: &RunContext) -> Logged {
    let Stages { edges, hough, disk_response } = &found.stages;
    log_frame(tape, found, context)?;
    // a stage that was not kept is empty
    if !edges.values.is_empty() {
        log_edges(tape, edges)?;
    }
    if !hough.votes.is_empty() {
        log_hough(tape, hough)?;
    }
    if !disk_response.values.is_empty() {
        log_disk_response(tape, disk_response, &found.detections)?;
    }
    Ok(())
}

fn log_frame(tape: &Tape, found: &LocalisedRecord, context: &RunContext) -> Logged {
    tape.log("vision/frame/image", &picture::jpeg(&found.frame)?.with_draw_order(-10.0))?;
    let outline: Vec<_> = outline_px(&found.table).map(in_frame).collect();
    let strip = LineStrips2D::new([outline]).with_colors([paint::color(paint::TRUE)]);
    tape.log("vision/frame/table", &strip.with_radii([paint::thin(1.0)]))?;
    let corners = Points2D::new(found.table.corners_px.map(in_frame))
        .with_labels(["1", "2", "3", "4"])
        .with_colors([paint::color(paint::TRUE)])
        .with_radii([paint::thin(4.0)]);
    tape.log("vision/frame/corners", &corners)?;
    let labels = found.detections.iter().enumerate().map(|(i, part)| {
        let id = context.parts.get(i).map_or("part", |look| look.id.as_str());
        format!("{id}, score {:.2}", part.score)
    });
    let below = found.detections.iter().map(|part| in_frame(part.center_px + Vec2::y() * part.radius_px));
    tape.log("vision/frame/names", &paint::names(below, &labels.collect::<Vec<_>>()))?;
    let circles = Ellipses2D::from_centers_and_half_sizes(
        found.detections.iter().map(|part| in_frame(part.center_px)),
        found.detections.iter().map(|part| [part.radius_px as f32; 2]),
    );
    let circles = circles.with_colors([paint::color(paint::MEASURED)]).with_line_radii([paint::thin(1.0)]);
    tape.log("vision/frame/parts", &circles)
}

fn log_edges(tape: &Tape, edges: &Plane) -> Logged {
    let edges = pooled(edges, [2, 2]);
    let strong = quantile(&edges.values, 0.9);
    tape.log("vision/edges/map", &picture::gray_png(&edges, strong)?.with_draw_order(-10.0))
}

fn log_hough(tape: &Tape, hough: &HoughArray) -> Logged {
    // the root, so that one strong line does not hide the rest
    let values = hough.votes.iter().map(|&votes| votes.max(0.0).sqrt()).collect();
    let votes = Plane { width: hough.angles, height: hough.distances, values };
    let factors = [hough.angles.div_ceil(VOTES_PX[0]).max(1), hough.distances.div_ceil(VOTES_PX[1]).max(1)];
    let map = pooled(&votes, factors);
    let top = map.values.iter().copied().fold(0.0, f32::max);
    tape.log("vision/hough/votes", &picture::heat_png(&map, top)?.with_draw_order(-10.0))?;
    let place = |&(column, row): &(usize, usize)| {
        [(column as f32 + 0.5) / factors[0] as f32, (row as f32 + 0.5) / factors[1] as f32]
    };
    let degrees = |column: usize| 360.0 * column as f64 / hough.angles.max(1) as f64;
    let labels = hough
        .peaks
        .iter()
        .map(|&(column, row)| format!("{:.0}°, {:.0} px", degrees(column), row as f64 * hough.px_per_row));
    let rings =
        Ellipses2D::from_centers_and_half_sizes(hough.peaks.iter().map(place), hough.peaks.iter().map(|_| [7.0; 2]))
            .with_labels(labels)
            .with_show_labels(true)
            .with_colors([paint::color(paint::TRUE)])
            .with_line_radii([paint::thin(1.0)]);
    tape.log("vision/hough/peaks", &rings)
}

fn log_disk_response(tape: &Tape, response: &Plane, detections: &[Detection]) -> Logged {
    let map = pooled(response, [2, 2]);
    tape.log("vision/disk_response/map", &picture::heat_png(&map, 1.0)?.with_draw_order(-10.0))?;
    let peaks = Points2D::new(detections.iter().map(|part| in_half_frame(part.center_px)))
        .with_labels(detections.iter().map(|part| format!("{:.2}", part.score)))
        .with_show_labels(true)
        .with_colors([paint::color(paint::TRUE)])
        .with_radii([paint::thin(3.0)]);
    tape.log("vision/disk_response/peaks", &peaks)
}

/// The value that `q` of all positive values stay below; 0 when there are none.
fn quantile(values: &[f32], q: f64) -> f32 {
    let mut positive: Vec<f32> = values.iter().copied().filter(|&value| value > 0.0).collect();
    let rank = (positive.len() as f64 * q) as usize;
    if rank >= positive.len() {
        return 0.0;
    }
    *positive.select_nth_unstable_by(rank, f32::total_cmp).1
}
