use re_sdk_types::archetypes::{Ellipses2D, EncodedImage, Points2D};
use re_sdk_types::components::Color;

use super::observation::Observation;
use super::paint::{self, in_half_frame};
use super::run_stream::{LogResult, RunStream};
use super::task::TaskOverlay;
use super::trails::Trails;
use crate::types::RunContext;
use upm_control::CycleFacts;
use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_perception::vision::{Table, Track};
use upm_recording::outline_px;

const JPEG_QUALITY: u8 = 75;

/// The camera's view at the start of each cycle: the frame at half its size with the detections.
pub(super) struct CameraView {
    colors: Vec<Color>,
    table: Option<Table>,
    trails: Trails,
}

impl CameraView {
    /// Logs the names of the parts, without their places.
    pub(super) fn start(stream: &RunStream, context: &RunContext) -> Result<Self, String> {
        let colors = paint::colors(paint::palette(&context.parts).parts());
        stream.log_static("camera/names", &paint::names(&context.parts, colors.clone()))?;
        Ok(Self { colors, table: None, trails: Trails::new(context.parts.len(), 6.0) })
    }

    pub(super) fn localised(&mut self, stream: &RunStream, table: Table, context: &RunContext) -> LogResult {
        let outline: Vec<_> = outline_px(&table).map(in_half_frame).collect();
        stream.log("camera/table", &paint::lines([outline], paint::TRUE, 1.0))?;
        TaskOverlay { root: "camera", is_static: false, place: |p_m| place(&table, p_m) }.log(stream, context)?;
        self.table = Some(table);
        Ok(())
    }

    /// Adds an observation to the trails; logs it where it has a frame.
    pub(super) fn observed(&mut self, stream: &RunStream, seen: &Observation) -> LogResult {
        let centers_px: Vec<Vec2> = seen.tracks.iter().map(|track| track.seen.center_px).collect();
        self.trails.push(&centers_px);
        seen.frame.as_ref().map_or(Ok(()), |frame| self.picture(stream, frame, &seen.tracks))
    }

    fn picture(&self, stream: &RunStream, frame: &Frame, tracks: &[Track]) -> LogResult {
        if !frame.pixels.is_empty() {
            let image = jpeg_at_half_size(frame)?;
            stream.log("camera/image", &image.with_draw_order(-10.0))?;
        }
        let disc = |track: &Track| (in_half_frame(track.seen.center_px), track.seen.radius_px as f32 / 2.0);
        let (centers, radii): (Vec<_>, Vec<_>) = tracks.iter().map(disc).map(|(at, radius)| (at, [radius; 2])).unzip();
        let circles = Ellipses2D::from_centers_and_half_sizes(centers, radii).with_line_radii([paint::thin(1.5)]);
        stream.log("camera/parts", &circles.with_colors(self.colors.clone()))?;
        let places = tracks.iter().map(disc).map(paint::below);
        stream.log("camera/names", &Points2D::update_fields().with_positions(places))?;
        let trails = paint::lines(self.trails.strips(in_half_frame), paint::MEASURED, 1.0);
        stream.log("camera/trails", &trails.with_colors(self.colors.clone()))
    }

    /// Logs the targets of the parts in the picture.
    pub(super) fn wanted(&self, stream: &RunStream, cycle: &CycleFacts) -> LogResult {
        let Some(table) = &self.table else { return Ok(()) };
        let targets = paint::dots(cycle.wanted.targets_m.iter().map(|&p_m| place(table, p_m)), paint::TARGET, 4.0);
        stream.log("camera/targets", &targets.with_colors(self.colors.clone()))
    }
}

/// A point of the table in the view.
fn place(table: &Table, p_m: Vec2) -> [f32; 2] {
    in_half_frame(table.lens.image_from_ideal(table.ideal_from_table.apply(p_m)))
}

/// `frame` at half its size, each pixel the mean of four, as JPEG.
fn jpeg_at_half_size(frame: &Frame) -> Result<EncodedImage, String> {
    let (width, height) = (frame.width / 2, frame.height / 2);
    let mut halved = Vec::with_capacity(width * height);
    let mut columns: Vec<u16> = Vec::with_capacity(frame.width);
    for y in 0..height {
        let (top, bottom) = (frame.row(2 * y), frame.row(2 * y + 1));
        columns.clear();
        columns.extend(top.iter().zip(bottom).map(|(&a, &b)| u16::from(a) + u16::from(b)));
        halved.extend(columns.as_chunks::<2>().0.iter().map(|[left, right]| ((left + right + 2) / 4) as u8));
    }
    let (Ok(w), Ok(h)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(format!("a picture of {width} × {height} px is too large for JPEG"));
    };
    let mut bytes = Vec::with_capacity(halved.len() / 8);
    jpeg_encoder::Encoder::new(&mut bytes, JPEG_QUALITY)
        .encode(&halved, w, h, jpeg_encoder::ColorType::Luma)
        .map_err(|e| e.to_string())?;
    Ok(EncodedImage::new(bytes).with_media_type("image/jpeg"))
}
