use super::names::{self, Names};
use super::paint::{self, in_frame, in_half_frame};
use super::picture;
use super::tape::{LogResult, RunStream};
use upm_chart::{Ground, Palette};
use upm_core::signal::Frame;
use upm_perception::vision::{DebugImages, FloatImage, HoughArray};
use upm_recording::LocalisedRecord;
use upm_recording::{edge_map, outline_px, response_map, vote_map};

/// Size of one of four views in a window of 1280 by 800 points, in points of the screen.
const QUARTER: [f64; 2] = [640.0, 330.0];

/// Largest size of the map of votes, px: its peaks are small, and the view is wide.
const VOTES_PX: [usize; 2] = [720, 410];

/// Logs the localisation of table and parts: the frame at full size, edges, Hough votes and disk response, each with
/// its findings. `names` are those of the parts.
pub(super) fn log(tape: &RunStream, found: &LocalisedRecord, names: &[&str]) -> LogResult {
    let DebugImages { edges, hough, disk_response } = &found.stages;
    log_frame(tape, found, names)?;
    // a stage that was not kept is empty
    if !edges.values.is_empty() {
        log_edges(tape, edges, &found.frame)?;
    }
    if !hough.votes.is_empty() {
        log_hough(tape, hough)?;
    }
    if !disk_response.values.is_empty() {
        log_disk_response(tape, disk_response, found)?;
    }
    Ok(())
}

fn log_frame(tape: &RunStream, found: &LocalisedRecord, names: &[&str]) -> LogResult {
    tape.log("vision/frame/image", &picture::jpeg(&found.frame)?.with_draw_order(-10.0))?;
    let outline: Vec<_> = outline_px(&found.table).map(in_frame).collect();
    tape.log("vision/frame/table", &paint::lines([outline], paint::TRUE, 1.0))?;
    let corners = paint::dots(found.table.corners_px.map(in_frame), paint::TRUE, 4.0);
    tape.log("vision/frame/corners", &corners.with_labels(["1", "2", "3", "4"]))?;
    // scores are in the view of the disk response: with one text per part, many parts remain legible
    let labels: Vec<&str> = (0..found.detections.len()).map(|i| *names.get(i).unwrap_or(&"part")).collect();
    let discs = || found.detections.iter().map(|part| (in_frame(part.center_px), part.radius_px as f32));
    let kinds: Vec<&str> = labels.iter().map(|name| names::kind_of(name)).collect();
    let palette = Palette::of(&kinds, Ground::Dark);
    let bounds = [found.frame.width, found.frame.height].map(|side| [0.0, side as f64]);
    let mut beside = Names::new(&labels, palette.parts(), bounds, QUARTER);
    tape.log("vision/frame/names", &beside.beside(discs()))?;
    let circles = paint::circles(discs(), paint::MEASURED, 1.0);
    tape.log("vision/frame/parts", &circles.with_colors(paint::colors(palette.parts())))
}

fn log_edges(tape: &RunStream, edges: &FloatImage, frame: &Frame) -> LogResult {
    let map = edge_map(edges, [frame.width, frame.height], 2);
    tape.log("vision/edges/map", &picture::gray_png(&map)?.with_draw_order(-10.0))
}

fn log_hough(tape: &RunStream, hough: &HoughArray) -> LogResult {
    let map = vote_map(hough, VOTES_PX);
    tape.log("vision/hough/votes", &picture::color_png(&map.picture)?.with_draw_order(-10.0))?;
    let degrees = |column: usize| 360.0 * column as f64 / hough.angles.max(1) as f64;
    let labels = hough
        .peaks
        .iter()
        .map(|&(column, row)| format!("{:.0}°, {:.0} px", degrees(column), row as f64 * hough.px_per_row));
    let rings = paint::circles(map.peaks.iter().map(|&peak| (peak, 7.0)), paint::TRUE, 1.0);
    tape.log("vision/hough/peaks", &rings.with_labels(labels).with_show_labels(true))
}

fn log_disk_response(tape: &RunStream, response: &FloatImage, found: &LocalisedRecord) -> LogResult {
    let map = response_map(response, [found.frame.width, found.frame.height], 2);
    tape.log("vision/disk_response/map", &picture::color_png(&map)?.with_draw_order(-10.0))?;
    let peaks = found.detections.iter().map(|part| in_half_frame(part.center_px));
    let scores = found.detections.iter().map(|part| format!("{:.2}", part.score));
    let peaks = paint::dots(peaks, paint::TRUE, 3.0).with_labels(scores).with_show_labels(true);
    tape.log("vision/disk_response/peaks", &peaks)
}
