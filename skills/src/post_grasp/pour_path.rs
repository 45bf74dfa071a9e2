//! Where the palm must go to pour a held vessel into a target.
//!
//! Everything here is geometry on what the cameras saw before the grasp: the vessel within a body of revolution about its upright
//! axis, with a round mouth, the target as an open circle.

use nalgebra::{Rotation3, Unit, UnitQuaternion};
use serde::{Deserialize, Serialize};
use sfg_geometry::Oval;
use sfg_types::{ObjectCluster, Point, Pose, ShapeClass, Vector};

/// A vessel as what surrounds it when it turns about its upright axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VesselShape {
    /// Base centre, vertical axis, at the moment it was seen.
    pub base_from_vessel: Pose,
    /// From the base to the mouth, metres.
    pub height_m: f64,
    /// Largest radius, metres.
    pub body_radius_m: f64,
    /// Radius of the mouth, metres.
    pub mouth_radius_m: f64,
}

/// Points closer than this to the top belong to the mouth.
const MOUTH_BAND_M: f64 = 0.015;
/// Share of the points left out as flying pixels at each end of a sorted measure.
const TRIM: f64 = 0.02;

/// The upright vessel that explains a cluster; `None` without points.
///
/// Axis through the cluster's centre (the grounder completes half-seen round things); radii are medians of distances from it,
/// so that a handle does not widen the body.
#[must_use]
pub fn vessel_shape(cluster: &ObjectCluster, table_height_m: f64) -> Option<VesselShape> {
    let axis = cluster.centre_in_base;
    let mut heights: Vec<f64> = cluster.points_in_base.iter().map(|point| f64::from(point.z) - table_height_m).collect();
    if heights.is_empty() {
        return None;
    }
    heights.sort_by(f64::total_cmp);
    let height_m = heights[((heights.len() - 1) as f64 * (1.0 - TRIM)) as usize];
    let median_radius_m = |oval: &Oval, low_m: f64, high_m: f64| -> Option<f64> {
        let mut radii_m: Vec<f64> = cluster
            .points_in_base
            .iter()
            .filter(|point| (low_m..=high_m).contains(&(f64::from(point.z) - table_height_m)))
            .map(|point| oval.radius_through_m(&(point.cast::<f64>() - axis).xy()))
            .collect();
        radii_m.sort_by(f64::total_cmp);
        radii_m.get(radii_m.len() / 2).copied()
    };
    let oval = cross_section(cluster);
    let mean_radius_m = median_radius_m(&oval, 0.2 * height_m, 0.7 * height_m);
    let body_radius_m = mean_radius_m.map_or(cluster.size_m.y / 2.0, |radius_m| oval.half_axes_m(radius_m)[0]);
    let mouth_radius_m = median_radius_m(&Oval::ROUND, height_m - MOUTH_BAND_M, height_m + MOUTH_BAND_M)
        .unwrap_or(body_radius_m)
        .min(body_radius_m);
    Some(VesselShape {
        base_from_vessel: Pose::translation(axis.x, axis.y, table_height_m),
        height_m,
        body_radius_m,
        mouth_radius_m,
    })
}

/// The form of a cluster's horizontal cross-section, base frame.
#[must_use]
pub fn cross_section(cluster: &ObjectCluster) -> Oval {
    match cluster.shape {
        ShapeClass::UprightOval => Oval::new(cluster.yaw_rad, (cluster.size_m.x / cluster.size_m.y.max(1e-3)).max(1.0)),
        _ => Oval::ROUND,
    }
}

/// The opening that is poured into.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PourTarget {
    /// Centre of the opening at the height of its rim.
    pub rim_centre_in_base: Point,
    /// Radius of the opening, metres.
    pub rim_radius_m: f64,
}

impl PourTarget {
    /// The opening of an upright round cluster.
    #[must_use]
    pub fn of(cluster: &ObjectCluster, table_height_m: f64) -> Self {
        let centre = cluster.centre_in_base;
        Self {
            rim_centre_in_base: Point::new(centre.x, centre.y, table_height_m + cluster.size_m.z),
            rim_radius_m: cluster.size_m.y / 2.0,
        }
    }
}

/// How to pour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PourSettings {
    /// Largest tilt from upright. A few grains at the bottom leave a vessel with a shoulder only well past horizontal.
    pub max_tilt_rad: f64,
    /// Gap kept between the vessel and the target's rim.
    pub rim_clearance_m: f64,
    /// How far before the centre the lip stays, since what leaves it flies on.
    pub lip_setback_m: f64,
    /// Waypoint spacing along the tilt.
    pub tilt_step_rad: f64,
}

impl Default for PourSettings {
    fn default() -> Self {
        Self { max_tilt_rad: 135_f64.to_radians(), rim_clearance_m: 0.045, lip_setback_m: 0.02, tilt_step_rad: 0.05 }
    }
}

/// Pose of the vessel at one tilt about its lip.
///
/// `heading_rad` is the horizontal direction of flow. The lip stays over one point; its height is the lowest at which the
/// whole vessel clears the rim, so it sinks as the vessel turns over.
#[must_use]
pub fn vessel_at_tilt(
    shape: &VesselShape,
    target: &PourTarget,
    heading_rad: f64,
    tilt_rad: f64,
    settings: &PourSettings,
) -> Pose {
    let flow = Vector::new(heading_rad.cos(), heading_rad.sin(), 0.0);
    let axis = Unit::new_normalize(Vector::z().cross(&flow));
    let rotation = Rotation3::from_axis_angle(&axis, tilt_rad);
    let lip = Vector::z() * shape.height_m + flow * shape.mouth_radius_m;
    let lowest_m = lowest_point_below_lip_m(shape, &rotation, &flow, &lip);
    let mut lip_in_base = target.rim_centre_in_base.coords - flow * settings.lip_setback_m;
    lip_in_base.z += settings.rim_clearance_m + lowest_m;
    let yaw = shape.base_from_vessel.rotation;
    Pose::from_parts((lip_in_base - rotation * lip).into(), UnitQuaternion::from_rotation_matrix(&rotation) * yaw)
}

/// How far the vessel reaches below its lip: base edge, shoulder and mouth edge, as circles about the axis.
fn lowest_point_below_lip_m(shape: &VesselShape, rotation: &Rotation3<f64>, flow: &Vector, lip: &Vector) -> f64 {
    let across = Vector::z().cross(flow);
    let circles =
        [(0.0, shape.body_radius_m), (shape.height_m * 0.75, shape.body_radius_m), (shape.height_m, shape.mouth_radius_m)];
    let mut lowest = 0.0_f64;
    for (height_m, radius_m) in circles {
        let centre = rotation * (Vector::z() * height_m - lip);
        let (u, v) = (rotation * flow, rotation * across);
        lowest = lowest.max(-(centre.z - radius_m * u.z.hypot(v.z)));
    }
    lowest
}

/// Palm poses from upright beside the target to full tilt, `palm_from_vessel` staying fixed.
#[must_use]
pub fn pour_palm_path(
    shape: &VesselShape,
    palm_from_vessel: &Pose,
    target: &PourTarget,
    heading_rad: f64,
    settings: &PourSettings,
) -> Vec<Pose> {
    let n_steps = (settings.max_tilt_rad / settings.tilt_step_rad).ceil().max(1.0) as usize;
    (0..=n_steps)
        .map(|step| {
            let tilt_rad = settings.max_tilt_rad * step as f64 / n_steps as f64;
            vessel_at_tilt(shape, target, heading_rad, tilt_rad, settings) * palm_from_vessel.inverse()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTTLE: VesselShape = VesselShape {
        base_from_vessel: Pose {
            rotation: UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(1.0, 0.0, 0.0, 0.0)),
            translation: nalgebra::Translation3::new(0.8, 0.2, 0.75),
        },
        height_m: 0.2,
        body_radius_m: 0.035,
        mouth_radius_m: 0.022,
    };
    const BOWL: PourTarget = PourTarget { rim_centre_in_base: Point::new(0.8, 0.0, 0.81), rim_radius_m: 0.08 };

    #[test]
    fn the_lip_stays_over_one_point_and_the_vessel_above_the_rim() {
        let settings = PourSettings::default();
        for heading_deg in [0.0_f64, 90.0, 200.0] {
            let heading_rad = heading_deg.to_radians();
            for tilt_deg in [0.0_f64, 45.0, 90.0, 135.0] {
                let pose = vessel_at_tilt(&BOTTLE, &BOWL, heading_rad, tilt_deg.to_radians(), &settings);
                let lip = pose * Point::new(0.022 * heading_rad.cos(), 0.022 * heading_rad.sin(), 0.2);
                let expected = Vector::new(heading_rad.cos(), heading_rad.sin(), 0.0) * -settings.lip_setback_m;
                assert!((lip.x - BOWL.rim_centre_in_base.x - expected.x).abs() < 1e-9, "{heading_deg} {tilt_deg} {lip}");
                assert!((lip.y - BOWL.rim_centre_in_base.y - expected.y).abs() < 1e-9, "{heading_deg} {tilt_deg} {lip}");
                for angle in 0..24 {
                    let (sin, cos) = (f64::from(angle) * 0.2618).sin_cos();
                    for (z, r) in [(0.0, 0.035), (0.15, 0.035), (0.2, 0.022)] {
                        let point = pose * Point::new(r * cos, r * sin, z);
                        assert!(point.z > 0.81 + settings.rim_clearance_m - 1e-9, "{heading_deg} {tilt_deg}: {point}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_palm_keeps_its_place_on_the_vessel() {
        let palm_from_vessel = Pose::new(Vector::new(0.01, 0.1, 0.04), Vector::new(0.3, 1.2, -0.4));
        let path = pour_palm_path(&BOTTLE, &palm_from_vessel, &BOWL, 1.0, &PourSettings::default());
        let upright = path[0] * palm_from_vessel * Vector::z();
        assert!((upright - Vector::z()).norm() < 1e-9);
        let full = path[path.len() - 1] * palm_from_vessel * Vector::z();
        assert!((full.z - 135_f64.to_radians().cos()).abs() < 1e-9);
    }
}
