//! How a vessel lies in the hand after closing and lifting: it turns and slides while the fingers pull.
//!
//! The vessel's outline was seen while it stood free. Here the pose of that outline is fitted to what the cameras see of it
//! between the fingers.

use crate::post_grasp::pour_path::{VesselShape, cross_section};
use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use sfg_geometry::{Oval, cloud};
use sfg_plugin::SelfSphere;
use sfg_types::{ObjectCluster, Observation, Point, Pose};

/// Form and mean radius over height, from the base up.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    height_m: f64,
    oval: Oval,
    radii_m: Vec<f64>,
}

/// Bands of the outline, and meridians where its surface is sampled.
const N_BANDS: usize = 12;
const N_AROUND: usize = 16;

impl Outline {
    /// The outline of a cluster that stands free; bands without points take the nearest band's radius.
    #[must_use]
    pub fn of(cluster: &ObjectCluster, shape: &VesselShape) -> Self {
        let vessel_from_base = shape.base_from_vessel.inverse();
        let oval = cross_section(cluster);
        let mut bands: Vec<Vec<f64>> = vec![Vec::new(); N_BANDS];
        for point in &cluster.points_in_base {
            let point = vessel_from_base * point.cast::<f64>();
            let band = (point.z / shape.height_m * N_BANDS as f64).floor();
            if (0.0..N_BANDS as f64).contains(&band) {
                bands[band as usize].push(oval.radius_through_m(&point.xy().coords));
            }
        }
        let medians: Vec<Option<f64>> = bands
            .into_iter()
            .map(|mut band| {
                band.sort_by(f64::total_cmp);
                band.get(band.len() / 2).copied()
            })
            .collect();
        let radii_m = (0..N_BANDS)
            .map(|band| {
                let nearest = (0..N_BANDS).filter(|other| medians[*other].is_some()).min_by_key(|other| other.abs_diff(band));
                nearest.and_then(|other| medians[other]).unwrap_or(shape.body_radius_m)
            })
            .collect();
        Self { height_m: shape.height_m, oval, radii_m }
    }

    fn radius_m(&self, height_m: f64) -> f64 {
        let at = (height_m / self.height_m * N_BANDS as f64 - 0.5).clamp(0.0, N_BANDS as f64 - 1.0);
        let below = at.floor() as usize;
        let above = (below + 1).min(N_BANDS - 1);
        let share = at - below as f64;
        self.radii_m[below] * (1.0 - share) + self.radii_m[above] * share
    }

    /// Points all over the side, vessel frame.
    fn surface(&self) -> impl Iterator<Item = Point> + '_ {
        let around = (0..N_AROUND).map(|step| {
            let (sin, cos) = (std::f64::consts::TAU * step as f64 / N_AROUND as f64).sin_cos();
            self.oval.stretch() * nalgebra::Vector2::new(cos, sin)
        });
        around.flat_map(move |round| {
            self.radii_m.iter().enumerate().map(move |(band, radius_m)| {
                let height_m = (band as f64 + 0.5) / N_BANDS as f64 * self.height_m;
                Point::new(round.x * radius_m, round.y * radius_m, height_m)
            })
        })
    }

    /// Signed distance of a point from the outer surface, nearly: metres, positive outside.
    fn distance_m(&self, point_in_vessel: &Point) -> f64 {
        let side = self.oval.distance_m(&point_in_vessel.xy().coords, self.radius_m(point_in_vessel.z));
        let end = (point_in_vessel.z - self.height_m).max(-point_in_vessel.z);
        if end > 0.0 && side > 0.0 { end.hypot(side) } else { side.max(end) }
    }
}

/// A fitted pose and how well it explains the points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldPose {
    /// The vessel: base centre, +Z to the mouth.
    pub base_from_vessel: Pose,
    /// Points that the fit rests on.
    pub n_points: usize,
    /// Their root-mean-square distance from the outline, metres.
    pub rms_m: f64,
}

/// Farther from the outline than this is something else: a finger, the inside, the table.
const INLIER_M: f64 = 0.012;
/// Fewest points for a fit.
const MIN_POINTS: usize = 150;
/// A fit this rough explains nothing.
const MAX_RMS_M: f64 = 0.006;
/// A vessel that seems to have moved more is another thing.
const MAX_SHIFT_M: f64 = 0.06;
const MAX_TURN_RAD: f64 = 0.8;
const N_STEPS: usize = 15;
/// A camera that sees this far past a place sees that nothing is there, metres.
const PAST_M: f64 = 0.02;
/// A vessel of which the cameras see past more than this share is not there.
const MAX_SEEN_PAST: f64 = 0.15;
/// The pull towards the guess, in points: it decides what the points leave open.
const GUESS_WEIGHT: f64 = 5.0;

/// Surface points near where the vessel should be, robot and table left out.
#[must_use]
pub fn points_near(
    observation: &Observation,
    robot: &[SelfSphere],
    guess: &Pose,
    height_m: f64,
    table_height_m: f64,
) -> Vec<Point> {
    let middle = guess * Point::new(0.0, 0.0, height_m / 2.0);
    let reach_m = height_m / 2.0 + MAX_SHIFT_M;
    let nearby: Vec<&SelfSphere> =
        robot.iter().filter(|ball| (ball.centre_in_base - middle).norm() < reach_m + ball.radius_m).collect();
    let mut points = Vec::new();
    for view in &observation.views {
        for point in cloud::points_in_base(view, None) {
            let is_near = (point - middle).norm() < reach_m && point.z > table_height_m + 0.01;
            if is_near && !nearby.iter().any(|ball| (point - ball.centre_in_base).norm() < ball.radius_m) {
                points.push(point);
            }
        }
    }
    points
}

/// Leans about the palm's normal from which a fit starts: closing turns an upright thing towards the palm's own axis.
const START_LEANS_RAD: [f64; 5] = [0.0, 0.2, -0.2, 0.4, -0.4];

/// Share of the vessel's surface at a pose that the cameras see past: where it would be, they see what is behind it.
fn seen_past(outline: &Outline, base_from_vessel: &Pose, observation: &Observation) -> f64 {
    let (mut n_seen, mut n_past) = (0_usize, 0_usize);
    for view in &observation.views {
        let camera_from_vessel = view.base_from_camera.inverse() * base_from_vessel;
        for point in outline.surface() {
            let in_camera = camera_from_vessel * point;
            let Some(pixel) = view.intrinsics.project(&in_camera) else { continue };
            let (width, height) = (view.intrinsics.width, view.intrinsics.height);
            if !(0.0..width as f64 - 0.5).contains(&pixel.x) || !(0.0..height as f64 - 0.5).contains(&pixel.y) {
                continue;
            }
            let depth_m = f64::from(view.depth_m[pixel.y.round() as usize * width + pixel.x.round() as usize]);
            if depth_m > 0.0 {
                n_seen += 1;
                n_past += usize::from(depth_m > in_camera.z + PAST_M);
            }
        }
    }
    n_past as f64 / n_seen.max(1) as f64
}

/// The pose of `outline` that explains most of `points`, near `guess`; `None` when they do not show the vessel well enough.
///
/// `base_from_palm` is where the vessel is held: fits start from several leans about its normal. A pose that `observation` sees past is none.
#[must_use]
pub fn fit_held_pose(
    outline: &Outline,
    points: &[Point],
    observation: &Observation,
    guess: &Pose,
    base_from_palm: &Pose,
) -> Option<HeldPose> {
    let palm_from_guess = base_from_palm.inverse() * guess;
    START_LEANS_RAD
        .iter()
        .filter_map(|lean_rad| {
            let lean = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), *lean_rad);
            let start = base_from_palm * Pose::from_parts(nalgebra::Translation3::identity(), lean) * palm_from_guess;
            fit_from(outline, points, &start)
        })
        .filter(|fit| {
            let moved = guess.inverse() * fit.base_from_vessel;
            let shift = moved * Point::new(0.0, 0.0, outline.height_m / 2.0) - Point::new(0.0, 0.0, outline.height_m / 2.0);
            fit.rms_m < MAX_RMS_M && shift.norm() < MAX_SHIFT_M && moved.rotation.angle() < MAX_TURN_RAD
        })
        .map(|fit| (seen_past(outline, &fit.base_from_vessel, observation), fit))
        .filter(|(past, _)| *past < MAX_SEEN_PAST)
        .max_by(|a, b| ((1.0 - a.0) * a.1.n_points as f64).total_cmp(&((1.0 - b.0) * b.1.n_points as f64)))
        .map(|(_, fit)| fit)
}

/// Gauss-Newton over the pose; the turn about a round vessel's own axis, which no point tells, stays that of the guess.
fn fit_from(outline: &Outline, points: &[Point], guess: &Pose) -> Option<HeldPose> {
    let mut pose = *guess;
    let mut fit = None;
    for _ in 0..N_STEPS {
        let mut normal = SMatrix::<f64, 6, 6>::identity() * GUESS_WEIGHT * 1e-4;
        let mut gradient = SVector::<f64, 6>::zeros();
        let (mut n_points, mut sum_squares) = (0, 0.0);
        let vessel_from_base = pose.inverse();
        for point in points {
            let p = vessel_from_base * point;
            let e = outline.distance_m(&p);
            if e.abs() > INLIER_M {
                continue;
            }
            let slope = slope_of(outline, &p);
            // Moving the vessel by d and turning it by w moves the point, as the vessel sees it, by -(d + w x p).
            let turn = p.coords.cross(&slope);
            let row = -SVector::<f64, 6>::new(slope.x, slope.y, slope.z, turn.x, turn.y, turn.z);
            normal += row * row.transpose();
            gradient += row * e;
            n_points += 1;
            sum_squares += e * e;
        }
        if n_points < MIN_POINTS {
            return None;
        }
        fit = Some(HeldPose { base_from_vessel: pose, n_points, rms_m: (sum_squares / f64::from(n_points as u32)).sqrt() });
        let step = normal.cholesky()?.solve(&-gradient);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[3], step[4], step[5]));
        pose *= Pose::from_parts(Vector3::new(step[0], step[1], step[2]).into(), turn);
        if step.norm() < 1e-6 {
            break;
        }
    }
    fit
}

fn slope_of(outline: &Outline, point: &Point) -> Vector3<f64> {
    const H: f64 = 1e-4;
    let along =
        |axis: Vector3<f64>| (outline.distance_m(&(point + axis * H)) - outline.distance_m(&(point - axis * H))) / (2.0 * H);
    Vector3::new(along(Vector3::x()), along(Vector3::y()), along(Vector3::z()))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    const OUTLINE_HEIGHT_M: f64 = 0.2;
    const BLIND: Observation = Observation { views: Vec::new(), stamp_secs: 0.0 };

    fn outline() -> Outline {
        let radii_m = (0..N_BANDS).map(|band| if band < 9 { 0.034 } else { 0.024 }).collect();
        Outline { height_m: OUTLINE_HEIGHT_M, oval: Oval::ROUND, radii_m }
    }

    /// Points of the upper half that two cameras in front and above would see.
    fn seen(pose: &Pose, shift: f64) -> Vec<Point> {
        let outline = outline();
        let mut points = Vec::new();
        for height in 0..40 {
            let z = 0.1 + 0.0025 * f64::from(height);
            for angle in 0..24 {
                let turn = f64::from(angle) * 0.13;
                let r = outline.radius_m(z) + shift;
                points.push(pose * Point::new(-r * turn.sin(), r * turn.cos(), z));
            }
        }
        for angle in 0..48 {
            let turn = f64::from(angle) * 0.131;
            points.push(pose * Point::new(0.023 * turn.cos(), 0.023 * turn.sin(), OUTLINE_HEIGHT_M));
        }
        points
    }

    #[test]
    fn a_turned_and_shifted_vessel_is_found() {
        let guess = Pose::translation(0.8, 0.2, 0.9);
        let truth = guess * Pose::new(Vector3::new(0.008, -0.006, 0.004), Vector3::new(0.2, -0.15, 0.0));
        let fit = fit_held_pose(&outline(), &seen(&truth, 0.0005), &BLIND, &guess, &guess).unwrap();
        let error = truth.inverse() * fit.base_from_vessel;
        assert!(error.translation.vector.norm() < 0.006, "{error}");
        let tilt = (error.rotation * Vector3::z()).angle(&Vector3::z());
        assert!(tilt < 0.05, "{tilt}");
    }

    #[test]
    fn too_few_points_or_another_thing_are_no_fit() {
        let guess = Pose::translation(0.8, 0.2, 0.9);
        assert!(fit_held_pose(&outline(), &seen(&guess, 0.0)[..100], &BLIND, &guess, &guess).is_none());
        let far = guess * Pose::translation(0.2, 0.0, 0.0);
        assert!(fit_held_pose(&outline(), &seen(&far, 0.0), &BLIND, &guess, &guess).is_none());
    }

    #[test]
    fn a_camera_that_sees_the_wall_behind_sees_no_vessel() {
        let intrinsics = sfg_types::CameraIntrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 80.0, cy: 60.0 };
        let along_x = nalgebra::Rotation3::from_basis_unchecked(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
        let base_from_camera =
            Pose::from_parts(Vector3::new(0.2, 0.2, 1.0).into(), UnitQuaternion::from_rotation_matrix(&along_x));
        let at = |depth_m: f32| Observation {
            views: vec![sfg_types::RgbdImage {
                camera: "front".into(),
                intrinsics,
                base_from_camera,
                rgb: vec![0; 3 * 160 * 120],
                depth_m: vec![depth_m; 160 * 120],
            }],
            stamp_secs: 0.0,
        };
        let guess = Pose::translation(0.8, 0.2, 0.9);
        let points = seen(&guess, 0.0);
        let fit = |depth_m| fit_held_pose(&outline(), &points, &at(depth_m), &guess, &guess);
        assert!(fit(0.56).is_some(), "the vessel's front, or something before it");
        assert!(fit(1.5).is_none(), "the wall");
    }
}
