use crate::config::{JobSpec, PlacedPart};
use crate::run::{RunError, simulated_rig};
use upm_core::geometry::Vec2;
use upm_core::ground_truth::{GroundTruth, GroundTruthHandle};
use upm_core::rig::{Rig, RigError, RigModel};
use upm_core::signal::{Drive, Frame};
use upm_perception::vision::locate_table;
use upm_sim::SimRig;

/// A simulated plate that plays one pulse at a time and is seen at rest after it.
///
/// Parts are measured where the camera without pixels sees them, relative to the plate. Their identity is the rig's.
pub(super) struct SteppedPlate {
    /// The rig, whose camera takes no pictures unless one is asked for.
    pub rig: SimRig,
    model: RigModel,
    probe: GroundTruthHandle,
    frame: Frame,
    /// The truth at the last observation.
    pub truth: GroundTruth,
    /// The parts at their start.
    pub parts: Vec<PlacedPart>,
    /// Measured positions, m.
    pub seen_m: Vec<Vec2>,
    /// Mean measured velocities over the last pulse and its rest, m/s.
    pub velocities_mps: Vec<Vec2>,
}

impl SteppedPlate {
    /// The plate of `job` with its parts at their start, seen once.
    pub fn new(job: &JobSpec) -> Result<Self, RunError> {
        let (rig, parts) = simulated_rig(job)?;
        let mut plate = Self {
            probe: rig.probe(),
            rig,
            truth: GroundTruth::default(),
            model: job.rig.model.clone(),
            frame: Frame::new(0, 0),
            velocities_mps: vec![Vec2::zeros(); parts.len()],
            seen_m: parts.iter().map(|part| part.position_m).collect(),
            parts,
        };
        plate.observe()?;
        Ok(plate)
    }

    /// True positions on the plate, m.
    pub fn true_m(&self) -> impl Iterator<Item = Vec2> {
        let GroundTruth { parts, plate_in_table, .. } = &self.truth;
        parts.iter().map(|part| plate_in_table.apply_inverse(part.part_in_table.position_m))
    }

    /// Plays `drive`, if there is one, until the parts are seen at rest; else until the next frame.
    pub fn play(&mut self, drive: Option<&Drive>) -> Result<(), RigError> {
        let (from, before_m) = (self.rig.now(), self.seen_m.clone());
        if let Some(drive) = drive {
            self.rig.play(drive)?;
        }
        self.observe()?;
        let took_s = self.rig.now().secs_since(from);
        let velocity_mps = |(now_m, before_m): (&Vec2, Vec2)| (now_m - before_m) / took_s;
        self.velocities_mps = self.seen_m.iter().zip(before_m).map(velocity_mps).collect();
        Ok(())
    }

    /// Captures frames until one that is exposed at rest.
    fn observe(&mut self) -> Result<(), RigError> {
        let settled_at = self.rig.settled_at();
        loop {
            self.rig.capture(&mut self.frame)?;
            if self.frame.exposed_at.secs_since(settled_at) >= 0.5 * self.model.exposure_s {
                break;
            }
        }
        self.truth = self.probe.read();
        // the plate may still swing a little, and the parts with it
        let table = locate_table(&self.frame, &self.model.lens, self.model.plate_side_m);
        if let (Ok(table), Some(found)) = (table, &self.frame.positions)
            && found.discs.len() == self.parts.len()
        {
            let places = found.discs.iter().zip(&self.parts);
            let place = places.map(|(disc, part)| table.part_in_table(disc.center_px, part.params.thickness_m));
            self.seen_m = place.collect();
        }
        Ok(())
    }
}
