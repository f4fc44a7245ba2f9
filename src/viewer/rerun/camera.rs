use super::looks::Looks;
use super::paint::{self, in_half_frame};
use super::picture;
use super::tape::{Logged, Tape};
use super::trails::Trails;
use crate::types::RunContext;
use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_perception::vision::{Table, Track};
use upm_recording::CycleRecord;
use upm_recording::outline_px;

/// The camera's view at the start of each cycle: the frame at half its size with the detections.
pub(super) struct CameraView {
    ids: Vec<String>,
    table: Option<Table>,
    trails: Trails,
    halved: Vec<u8>,
}

impl CameraView {
    pub(super) fn new(context: &RunContext) -> Self {
        let ids: Vec<String> = context.parts.iter().map(|part| part.id.clone()).collect();
        Self { trails: Trails::new(ids.len(), 6.0), ids, table: None, halved: Vec::new() }
    }

    pub(super) fn localised(&mut self, tape: &Tape, table: Table) -> Logged {
        let outline: Vec<_> = outline_px(&table).map(in_half_frame).collect();
        self.table = Some(table);
        tape.log("camera/table", &paint::lines([outline], paint::TRUE, 1.0))
    }

    pub(super) fn looks(&mut self, looks: &Looks) {
        looks.image_px.chunks(looks.parts().max(1)).for_each(|look| self.trails.push(look));
    }

    pub(super) fn picture(&mut self, tape: &Tape, frame: &Frame, tracks: &[Track]) -> Logged {
        let image = picture::jpeg_at_half_size(frame, &mut self.halved)?;
        tape.log("camera/image", &image.with_draw_order(-10.0))?;
        let discs = tracks.iter().map(|track| (in_half_frame(track.seen.center_px), track.seen.radius_px as f32 / 2.0));
        tape.log("camera/parts", &paint::circles(discs, paint::MEASURED, 1.0))?;
        let below = tracks.iter().map(|track| {
            let [x, y] = in_half_frame(track.seen.center_px);
            [x, y + track.seen.radius_px as f32 / 2.0]
        });
        tape.log("camera/names", &paint::names(below, &self.ids))?;
        tape.log("camera/trails", &paint::lines(self.trails.strips(in_half_frame), paint::MEASURED, 0.75))
    }

    /// Logs the targets of the parts in the picture.
    pub(super) fn wanted(&self, tape: &Tape, cycle: &CycleRecord) -> Logged {
        let Some(table) = &self.table else { return Ok(()) };
        let place = |&p_m: &Vec2| in_half_frame(table.lens.image_from_ideal(table.ideal_from_table.apply(p_m)));
        tape.log("camera/targets", &paint::dots(cycle.wanted.targets_m.iter().map(place), paint::TARGET, 4.0))
    }
}
