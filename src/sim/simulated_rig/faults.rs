use super::SimRig;
use crate::faults::{FaultyPlant, PlantChange, PlantFaults, SeenDisc};
use upm_core::geometry::Vec2;

impl FaultyPlant for SimRig {
    fn set_faults(&mut self, faults: &PlantFaults) {
        self.plant.set_faults(faults);
        self.exposure_factor = if faults.exposure > 0.0 { faults.exposure } else { 1.0 };
    }

    fn change(&mut self, change: PlantChange) {
        self.plant.change(change);
    }

    fn seen_disc(&self, place_m: Vec2) -> Option<SeenDisc> {
        let disc = self.camera.disc(0)?;
        let at = |p_m: Vec2| self.camera.image_from_table(p_m, disc.thickness_m);
        let center_px = at(place_m);
        let radius_px = (at(place_m + Vec2::new(disc.radius_m, 0.0)) - center_px).norm();
        let [_, _, level] = self.camera.params().levels;
        Some(SeenDisc { center_px, radius_px, level })
    }

    fn parts(&self) -> usize {
        self.plant.parts().len()
    }
}
