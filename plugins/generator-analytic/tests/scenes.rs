//! Candidates on half-seen synthetic things: two cameras above the shoulders, 640 x 480, a TSDF of 7.5 mm voxels.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod support;

use sfg_generator_analytic::hand::Hand;
use sfg_plugin::PluginError;
use sfg_types::{GraspType, HandSide, PalmPoseCandidate, Point, Pose, Tsdf, Vector};
use support::*;

/// Candidates of the shipped left hand, with the laws that hold for all of them.
#[track_caller]
fn found(solid: &Solid, kind: GraspType) -> Vec<PalmPoseCandidate> {
    let profile = softhand();
    let seen = observe(solid, 1);
    let found = candidates(&mut generator(&profile, HandSide::Left), &profile, &seen, HandSide::Left, kind);
    let hand = Hand::load(&profile, HandSide::Left, &scenarios_dir().join("robots")).unwrap();
    let open = hand.balls_at(&vec![0.0; profile.joints.len()]);
    for c in &found {
        assert!(c.stability > 0.0 && c.stability < 1.0 && term(c, "wrench_margin_weights") >= 0.0);
        for ball in &open {
            let centre = c.base_from_palm * Point::from(ball.centre);
            assert!(centre.z - ball.radius_m >= TABLE_M, "the open hand is inside the table at {centre}");
            // The true object, not the seen one: completion and voxels may cost a few millimetres.
            let depth = ball.radius_m - (solid.distance)(&centre);
            assert!(depth < 0.008, "the open hand is {depth:.4} m inside the object at {centre}");
        }
    }
    assert!(found.windows(2).all(|pair| pair[0].stability >= pair[1].stability));
    found
}

/// Angle between palm +Z and the shortest way from the palm to the axis, degrees.
fn off_axis_deg(pose: &Pose, on_axis: &Point, axis: &Vector) -> f64 {
    // The palm stands beside the axis by its offset along the fingers; what counts is that it faces the axis squarely.
    let z = pose * Vector::z();
    let x = pose * Vector::x();
    let to_axis = on_axis - pose * Point::origin();
    let to_axis = to_axis - axis * to_axis.dot(axis);
    let across = x - axis * x.dot(axis);
    let across = across.normalize();
    let square = to_axis - across * to_axis.dot(&across);
    let flat_z = z - axis * z.dot(axis);
    flat_z.angle(&square).to_degrees()
}

#[track_caller]
fn check_bottle(radius_m: f64, kind: GraspType) {
    let (x, y) = (0.62, 0.1);
    let all = found(&standing(x, y, radius_m, 0.2), kind);
    assert!(all.len() >= 10, "{} candidates", all.len());
    let mut sectors: Vec<i32> = Vec::new();
    for c in &all {
        let off = off_axis_deg(&c.base_from_palm, &Point::new(x, y, 0.0), &Vector::z());
        assert!(off < 10.0, "palm +Z misses the axis by {off:.1} deg");
        assert!((c.base_from_palm * Vector::z()).z < 0.2, "approaches from below");
        let z = c.base_from_palm * Vector::z();
        sectors.push((z.y.atan2(z.x) / 0.53).round() as i32);
    }
    sectors.sort_unstable();
    sectors.dedup();
    assert!(sectors.len() >= 5, "all candidates come from {} sides", sectors.len());
    for (name, least) in [("opposition", 0.6), ("steadiness", 0.6), ("balance", 0.9)] {
        let value = term(&all[0], name);
        assert!(value > least, "{name} of the best is {value:.2}");
    }
    // The bottle leans from the thumb to the finger tips, by up to half a radian.
    let to_thumb = all[0].base_from_palm.inverse() * Vector::z() * (all[0].base_from_palm * Vector::y()).z.signum();
    let lean_rad = to_thumb.x.atan2(to_thumb.y);
    assert!((0.0..0.6).contains(&lean_rad), "{lean_rad}");
}

#[test]
fn a_thin_bottle_is_wrapped_from_many_sides() {
    check_bottle(0.029, GraspType::MediumWrap);
}

#[test]
fn a_bottle_is_wrapped_from_many_sides() {
    check_bottle(0.035, GraspType::LargeDiameter);
}

#[test]
fn a_thick_bottle_is_wrapped_from_many_sides() {
    check_bottle(0.039, GraspType::LargeDiameter);
}

#[test]
fn flat_bottles_are_wrapped_however_they_are_turned() {
    for half_m in [[0.040, 0.023], [0.045, 0.027], [0.035, 0.026]] {
        for yaw_deg in [-70.0_f64, -30.0, 0.0, 40.0, 85.0] {
            let yaw = yaw_deg.to_radians();
            let all = found(&flat_bottle(0.7, 0.25, yaw, half_m, 0.2), GraspType::LargeDiameter);
            assert!(all.len() >= 8, "{half_m:?} at {yaw_deg} deg: {} candidates", all.len());
            assert!(term(&all[0], "opposition") > 0.5);
            // Square to one of the four faces, as well as the half-seen outline tells where they are: nearly round ones do not.
            for c in &all {
                let z = c.base_from_palm * Vector::z();
                let turn = ((z.y.atan2(z.x) - yaw) / std::f64::consts::FRAC_PI_2).rem_euclid(1.0);
                let off_deg = turn.min(1.0 - turn) * 90.0;
                assert!(
                    z.xy().norm() < 0.1 || half_m[0] < 1.5 * half_m[1] || off_deg < 25.0,
                    "{half_m:?} at {yaw_deg} deg: comes at {off_deg:.0} deg to a face"
                );
            }
            assert!(term(&all[0], "steadiness") > 0.3, "{}", term(&all[0], "steadiness"));
        }
    }
}

#[test]
fn a_lying_bottle_is_wrapped_from_above() {
    for radius_m in [0.023, 0.030, 0.036] {
        let z = TABLE_M + radius_m;
        let lying = cylinder([0.62, 0.15, z].into(), [0.74, 0.28, z].into(), radius_m);
        let all = found(&lying, GraspType::LargeDiameter);
        assert!(!all.is_empty(), "{radius_m}");
        assert!((all[0].base_from_palm * Vector::z()).z < -0.5 && term(&all[0], "opposition") > 0.5);
    }
}

#[test]
fn a_box_is_approached_square_to_its_faces() {
    let yaw = 0.4;
    let all = found(&cuboid(0.62, 0.1, yaw, [0.06, 0.05, 0.15]), GraspType::LargeDiameter);
    assert!(!all.is_empty());
    for c in &all {
        let z = c.base_from_palm * Vector::z();
        let turn = ((z.y.atan2(z.x) - yaw) / std::f64::consts::FRAC_PI_2).rem_euclid(1.0);
        assert!(z.xy().norm() < 0.1 || turn.min(1.0 - turn) * 90.0 < 12.0, "comes at {:.0} deg to a face", turn * 90.0);
    }
    assert!(term(&all[0], "opposition") > 0.6 && term(&all[0], "steadiness") > 0.6);
}

#[test]
fn a_small_box_is_taken_between_the_pads_from_above() {
    let all = found(&cuboid(0.62, 0.1, 0.4, [0.05, 0.03, 0.09]), GraspType::PrismaticFourFinger);
    assert!(!all.is_empty());
    assert!((all[0].base_from_palm * Vector::z()).z < -0.8);
    assert!(term(&all[0], "opposition") > 0.8);
}

#[test]
fn a_ball_is_held_from_above() {
    let all = found(&ball(0.62, 0.1, 0.035), GraspType::PowerSphere);
    assert!(!all.is_empty());
    assert!((all[0].base_from_palm * Vector::z()).z < -0.5);
    assert!(term(&all[0], "wrench_margin_weights") > 1.0);
}

/// Known limit: with the palm over a 12 mm rod 6 mm above the table the fingers cannot get under it, so nothing is promised.
#[test]
fn a_thin_handle_on_the_table_yields_only_poses_clear_of_the_table() {
    let rod = cylinder([0.55, 0.1, TABLE_M + 0.018].into(), [0.65, 0.25, TABLE_M + 0.018].into(), 0.012);
    found(&rod, GraspType::SmallDiameter);
}

#[test]
fn a_mug_handle_is_held_near_the_handle() {
    for c in found(&mug(0.62, 0.1, 2.0), GraspType::MediumWrap) {
        let grip = c.base_from_palm.translation.vector.xy() - Vector::new(0.62, 0.1, 0.0).xy();
        assert!(grip.norm() > 0.04, "the palm is inside the mug");
    }
}

/// The mirror image in the plane y = 0.
fn mirrored(pose: &Pose) -> Pose {
    let flip = |v: Vector| Vector::new(v.x, -v.y, v.z);
    let (x, z) = (flip(pose * Vector::x()), flip(pose * Vector::z()));
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[x, z.cross(&x), z]));
    Pose::from_parts(flip(pose.translation.vector).into(), nalgebra::UnitQuaternion::from_rotation_matrix(&rotation))
}

#[test]
fn the_other_hand_on_the_mirrored_scene_does_the_mirrored_thing() {
    let profile = softhand();
    let mut generator = generator(&profile, HandSide::Left);
    let left = candidates(
        &mut generator,
        &profile,
        &observe(&standing(0.62, 0.1, 0.033, 0.18), 1),
        HandSide::Left,
        GraspType::LargeDiameter,
    );
    let right = candidates(
        &mut generator,
        &profile,
        &observe(&standing(0.62, -0.1, 0.033, 0.18), 1),
        HandSide::Right,
        GraspType::LargeDiameter,
    );
    assert!(!left.is_empty());
    for c in left.iter().take(5) {
        let wanted = mirrored(&c.base_from_palm);
        let nearest = right
            .iter()
            .map(|r| ((r.base_from_palm.translation.vector - wanted.translation.vector).norm(), r))
            .filter(|(_, r)| r.base_from_palm.rotation.angle_to(&wanted.rotation) < 0.1)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let (gap_m, twin) = nearest.expect("a candidate has no mirror image");
        assert!(gap_m < 0.002, "the mirror image is {gap_m:.4} m away");
        assert!((twin.stability - c.stability).abs() < 0.02);
    }
}

#[test]
fn candidates_move_with_what_was_seen() {
    let profile = softhand();
    let mut generator = generator(&profile, HandSide::Left);
    let mut seen = observe(&standing(0.60, 0.12, 0.033, 0.18), 1);
    let here = candidates(&mut generator, &profile, &seen, HandSide::Left, GraspType::LargeDiameter);
    let shift = Vector::new(0.05, -0.03, 0.0);
    seen.tsdf.base_from_grid.translation.vector += shift;
    seen.key_point.point_in_base += shift;
    let there = candidates(&mut generator, &profile, &seen, HandSide::Left, GraspType::LargeDiameter);
    assert_eq!(here.len(), there.len());
    for (a, b) in here.iter().zip(&there) {
        let gap = (a.base_from_palm.translation.vector + shift - b.base_from_palm.translation.vector).norm();
        assert!(gap < 1e-4 && (a.stability - b.stability).abs() < 1e-3, "a candidate stays {gap} m behind");
    }
}

/// Seen anew from the cameras, where perspective shows another part of the surface.
#[test]
fn candidates_follow_an_object_that_was_moved() {
    let profile = softhand();
    let mut generator = generator(&profile, HandSide::Left);
    let mut check_at = |x: f64, y: f64| {
        let seen = observe(&standing(x, y, 0.033, 0.18), 1);
        let all = candidates(&mut generator, &profile, &seen, HandSide::Left, GraspType::LargeDiameter);
        assert!(!all.is_empty());
        for c in &all {
            let off = off_axis_deg(&c.base_from_palm, &Point::new(x, y, 0.0), &Vector::z());
            assert!(off < 10.0, "palm +Z misses the moved axis by {off:.1} deg");
            let away = (c.base_from_palm.translation.vector.xy() - Vector::new(x, y, 0.0).xy()).norm();
            assert!((0.03..0.08).contains(&away), "the palm is {away:.3} m from the moved axis");
        }
    };
    check_at(0.60, 0.12);
    check_at(0.65, 0.09);
}

#[test]
fn an_unseen_object_yields_nothing_and_the_same_question_the_same_answer() {
    let profile = softhand();
    let mut generator = generator(&profile, HandSide::Left);
    let mut seen = observe(&standing(0.62, 0.1, 0.033, 0.18), 1);
    let first = candidates(&mut generator, &profile, &seen, HandSide::Left, GraspType::LargeDiameter);
    assert_eq!(first, candidates(&mut generator, &profile, &seen, HandSide::Left, GraspType::LargeDiameter));
    seen.tsdf = Tsdf::unobserved(&seen.key_point.point_in_base);
    assert!(candidates(&mut generator, &profile, &seen, HandSide::Left, GraspType::LargeDiameter).is_empty());
}

#[test]
fn wrong_parameters_are_refused() {
    let profile = softhand();
    let dir = scenarios_dir();
    for params in [serde_json::json!({"candidates": 3}), serde_json::json!({"n_candidates": 0}), serde_json::json!("x")] {
        let context = sfg_plugin::PluginContext {
            params: &params,
            scenarios_dir: &dir,
            hand: &profile,
            hand_side: HandSide::Left,
            seed: 0,
        };
        let refused = sfg_generator_analytic::AnalyticGenerator::new(&context);
        assert!(matches!(refused, Err(PluginError::BadParameter { .. })), "{params} was accepted");
    }
}

#[test]
fn the_contract_is_kept() {
    let profile = softhand();
    let mut generator = generator(&profile, HandSide::Left);
    assert_eq!(sfg_plugin::testing::pose_generator_suite(&mut generator, &profile), Ok(()));
}
