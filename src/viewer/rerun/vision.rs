use super::names::Names;
use super::paint::{self, in_frame, in_half_frame};
use super::picture;
use super::run_stream::{LogResult, RunStream};
use upm_chart::{Ground, Palette};
use upm_perception::vision::{DebugImages, HoughArray};
use upm_recording::LocalisedRecord;
use upm_recording::{edge_map, outline_px, response_map, vote_map};

/// Size of one of four views in a window of 1280 by 800 points, in points of the screen.
const QUARTER: [f64; 2] = [640.0, 330.0];

/// Largest size of the map of votes, px: its peaks are small, and the view is wide.
const VOTES_PX: [usize; 2] = [720, 410];

/// Logs the localisation of table and parts: the frame at full size, edges, Hough votes and disk response, each with
/// its findings. `names` are those of the parts, `kinds` those of their kinds.
pub(super) fn log(stream: &RunStream, found: &LocalisedRecord, (names, kinds): (&[&str], &[&str])) -> LogResult {
    let DebugImages { edges, hough, disk_response } = &found.stages;
    let frame_px = [found.frame.width, found.frame.height];
    log_frame(stream, found, (names, kinds))?;
    // a stage that was not kept is empty
    if !edges.values.is_empty() {
        let map = picture::gray_png(&edge_map(edges, frame_px, 2))?;
        stream.log("vision/edges/map", &map.with_draw_order(-10.0))?;
    }
    if !hough.votes.is_empty() {
        log_hough(stream, hough)?;
    }
    if !disk_response.values.is_empty() {
        let map = picture::color_png(&response_map(disk_response, frame_px, 2))?;
        stream.log("vision/disk_response/map", &map.with_draw_order(-10.0))?;
        let peaks = found.detections.iter().map(|part| in_half_frame(part.center_px));
        let scores = found.detections.iter().map(|part| format!("{:.2}", part.score));
        let peaks = paint::dots(peaks, paint::TRUE, 3.0).with_labels(scores).with_show_labels(true);
        stream.log("vision/disk_response/peaks", &peaks)?;
    }
    Ok(())
}

fn log_frame(stream: &RunStream, found: &LocalisedRecord, (names, kinds): (&[&str], &[&str])) -> LogResult {
    if !found.frame.pixels.is_empty() {
        stream.log("vision/frame/image", &picture::jpeg(&found.frame)?.with_draw_order(-10.0))?;
    }
    let outline: Vec<_> = outline_px(&found.table).map(in_frame).collect();
    stream.log("vision/frame/table", &paint::lines([outline], paint::TRUE, 1.0))?;
    let corners = paint::dots(found.table.corners_px.map(in_frame), paint::TRUE, 4.0);
    stream.log("vision/frame/corners", &corners.with_labels(["1", "2", "3", "4"]))?;
    // scores are in the view of the disk response: with one text per part, many parts remain legible
    let count = found.detections.len();
    let [labels, kinds] =
        [names, kinds].map(|of| (0..count).map(|i| *of.get(i).unwrap_or(&"part")).collect::<Vec<&str>>());
    let discs = || found.detections.iter().map(|part| (in_frame(part.center_px), part.radius_px as f32));
    let palette = Palette::of(&kinds, Ground::Dark);
    let bounds = [found.frame.width, found.frame.height].map(|side| [0.0, side as f64]);
    let mut beside = Names::new((&labels, &kinds), palette.parts(), bounds, QUARTER);
    stream.log("vision/frame/names", &beside.beside(discs()))?;
    let circles = paint::circles(discs(), paint::MEASURED, 1.0);
    stream.log("vision/frame/parts", &circles.with_colors(paint::colors(palette.parts())))
}

fn log_hough(stream: &RunStream, hough: &HoughArray) -> LogResult {
    let map = vote_map(hough, VOTES_PX);
    stream.log("vision/hough/votes", &picture::color_png(&map.picture)?.with_draw_order(-10.0))?;
    let degrees = |column: usize| 360.0 * column as f64 / hough.angles.max(1) as f64;
    let labels = hough
        .peaks
        .iter()
        .map(|&(column, row)| format!("{:.0}°, {:.0} px", degrees(column), row as f64 * hough.px_per_row));
    let rings = paint::circles(map.peaks.iter().map(|&peak| (peak, 7.0)), paint::TRUE, 1.0);
    stream.log("vision/hough/peaks", &rings.with_labels(labels).with_show_labels(true))
}
