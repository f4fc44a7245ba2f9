//! Contact detection between part and array: rims of ridges against the part's faces and edges, and the part's bottom
//! corners against slabs.

use nalgebra::{Isometry3, Point3, Vector3};

use super::device::{Device, SLAB_M};
use super::part::PartShape;

/// A point at which part and resonator touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub point_m: Vector3<f64>,
    /// Unit normal towards the part.
    pub normal: Vector3<f64>,
    /// Overlap of the features, m.
    pub depth_m: f64,
}

/// Dimensions of a device needed for contacts, in the slab's own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    tip_m: [f64; 2],
    foot_m: [f64; 2],
    half_m: [f64; 3],
    rim_m: f64,
}

impl Outline {
    pub fn of(device: &Device) -> Self {
        let half_m = SLAB_M.map(|length_m| 0.5 * length_m);
        Self {
            // centres of the roundings: the outermost points are those of the sharp outline
            tip_m: [
                device.ridge_place_m + device.rim_radius_m,
                half_m[2] + device.ridge_height_m - device.rim_radius_m,
            ],
            foot_m: [-half_m[0] + device.rim_radius_m, half_m[2] - device.rim_radius_m],
            half_m,
            rim_m: device.rim_radius_m,
        }
    }

    /// Appends the contacts of a part with the resonator about the axis at `axis_m`, turned by `angle_rad`, to `found`.
    pub fn contacts(
        &self,
        axis_m: Vector3<f64>,
        angle_rad: f64,
        part: &PartShape,
        pose: &Isometry3<f64>,
        found: &mut Vec<Contact>,
    ) {
        let away = pose.translation.vector - axis_m;
        let reach = part.half_m + Vector3::from(self.half_m);
        // the part turns little: a margin covers it
        if away.x.abs() > 1.05 * reach.x || away.y.abs() > 1.3 * reach.y {
            return;
        }
        let (sine, cosine) = angle_rad.sin_cos();
        let raised = |[x, z]: [f64; 2]| axis_m + Vector3::new(x * cosine + z * sine, 0.0, z * cosine - x * sine);
        // the foot right under the tip matters where a part meets the slab's end below the rim
        for middle_m in [self.tip_m, self.foot_m].map(raised) {
            found.extend(self.rim_contacts(middle_m, part.half_m, pose).into_iter().flatten());
        }
        // the part's bottom corners and the top of the slab
        let half = part.half_m;
        for (x, y) in [(-half.x, -half.y), (-half.x, half.y), (half.x, -half.y), (half.x, half.y)] {
            let point_m = pose.transform_point(&Point3::new(x, y, -half.z)).coords;
            let from_axis = point_m - axis_m;
            let along = from_axis.x * cosine - from_axis.z * sine;
            let above = from_axis.x * sine + from_axis.z * cosine - self.half_m[2];
            let is_over = from_axis.y.abs() <= self.half_m[1] && along.abs() <= self.half_m[0];
            if is_over && above <= 0.0 && above > -self.half_m[2] {
                found.push(Contact { point_m, normal: Vector3::new(sine, 0.0, cosine), depth_m: -above });
            }
        }
    }

    /// Contacts of the rim along y, its middle at `middle_m`, at both ends of its stretch beneath the part.
    fn rim_contacts(&self, middle_m: Vector3<f64>, half: Vector3<f64>, pose: &Isometry3<f64>) -> [Option<Contact>; 2] {
        let end = |y: f64| pose.inverse_transform_point(&Point3::from(middle_m + Vector3::y() * y)).coords;
        let (from, to) = (end(-self.half_m[1]), end(self.half_m[1]));
        if from.z.min(to.z) > half.z || from.z.max(to.z) < -half.z - self.rim_m {
            return [None; 2];
        }
        let along = to - from;
        let [first, last] = [-half.y, half.y].map(|y| ((y - from.y) / along.y).clamp(0.0, 1.0));
        [first, last].map(|share| {
            let point = from + along * share;
            let (outward, distance_m) = touched(&point, &half, self.rim_m).filter(|_| first != last)?;
            let normal = -(pose.rotation * outward);
            let point_m = pose.transform_point(&Point3::from(point)).coords + normal * self.rim_m;
            Some(Contact { point_m, normal, depth_m: self.rim_m - distance_m })
        })
    }
}

/// Outward normal of the box at the point nearest to `point` and the distance to it, when that is within `rim_m`.
fn touched(point: &Vector3<f64>, half: &Vector3<f64>, rim_m: f64) -> Option<(Vector3<f64>, f64)> {
    let beyond = point.abs() - half;
    if beyond.max() > rim_m {
        return None;
    }
    // the y sides are left out: rims are cut there
    let out = Vector3::new(beyond.x.max(0.0), 0.0, beyond.z.max(0.0));
    let distance_m = out.norm();
    if distance_m > rim_m {
        return None;
    }
    if distance_m > 0.0 {
        return Some((out.component_mul(&point.map(f64::signum)) / distance_m, distance_m));
    }
    let axis = if beyond.x > beyond.z { 0 } else { 2 };
    let mut normal = Vector3::zeros();
    normal[axis] = point[axis].signum();
    Some((normal, beyond[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    /// Contacts of one tile at `angle_rad` with a part whose bottom is at `bottom_m` and whose front is at `front_m`
    /// from the rim.
    fn contacts(angle_rad: f64, front_m: f64, bottom_m: f64) -> Vec<Contact> {
        let device = Device { rim_radius_m: 1e-6, ..Device::published() };
        let part = PartShape::published();
        let center = Vector3::new(device.ridge_place_m + front_m - part.half_m.x, 0.0, bottom_m + part.half_m.z);
        let pose = Isometry3::from_parts(Translation3::from(center), UnitQuaternion::identity());
        let mut found = Vec::new();
        Outline::of(&device).contacts(Vector3::zeros(), angle_rad, &part, &pose, &mut found);
        found
    }

    #[test]
    fn rim_pushes_up_under_the_part_back_beside_its_front_and_both_ways_at_the_edge() {
        let under = contacts(0.0, 100e-6, 7.4e-6);
        assert_eq!(under.len(), 2, "at both ends: {under:?}");
        for contact in under {
            assert!((contact.normal - Vector3::z()).norm() < 1e-12);
            assert!((contact.point_m.y.abs() - 90e-6).abs() < 1e-9 && (contact.point_m.z - 7.5e-6).abs() < 1e-9);
        }
        let beside = contacts(0.0, 0.1e-6, 3.0e-6);
        let pushes_back = |contact: &Contact| (contact.normal + Vector3::x()).norm() < 1e-9;
        assert!(!beside.is_empty() && beside.iter().all(pushes_back), "{beside:?}");
        let at_the_edge = contacts(0.0, 0.3e-6, 7.2e-6);
        let edge = at_the_edge.iter().find(|contact| contact.normal.z > 0.1).unwrap();
        assert!(edge.normal.x < -0.3 && edge.normal.z < 0.95, "{edge:?}");
        for (angle_rad, bottom_m, touches) in [(0.0, 7.6e-6, false), (0.08, 18.8e-6, false), (0.08, 18.5e-6, true)] {
            assert_eq!(contacts(angle_rad, 100e-6, bottom_m).is_empty(), !touches, "{bottom_m}");
        }
    }
}
