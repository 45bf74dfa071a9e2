//! Plans of both arms over the table, with and without the torso: solved and times over seeded random pairs of configurations.
//!
//! `cargo bench -p sfg-planning --bench both_arms`. A pair is two free configurations whose palms are both over the table.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program")]

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{RobotModel, Shape};
use sfg_planning::{CollisionModel, CollisionSettings, KeepAxis, Obstacle, PlanOutcome, Planner, RrtConnect, RrtSettings};
use sfg_types::Pose;
use std::path::Path;
use std::time::Instant;

fn main() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml");
    let model = RobotModel::load(&path).unwrap();
    for name in ["left", "right", "both", "torso_both"] {
        measure(&model, name, None, 100, 0);
    }
    for (name, tilt_deg) in [("left", 30.0), ("left", 10.0), ("both", 30.0), ("both", 10.0)] {
        measure(&model, name, Some(tilt_deg), 100, 0);
    }
}

/// With a tilt, what is upright in the hands at home stays so within that angle, at both ends and on the way.
fn measure(model: &RobotModel, name: &str, tilt_deg: Option<f64>, n: usize, seed: u64) {
    let group = model.group(name).unwrap();
    let mut collision = CollisionModel::of_group(model, &group, &model.home_q, CollisionSettings::default()).unwrap();
    let shape = Shape::Cuboid { half_extents_m: Vector3::new(0.35, 0.7, 0.02) };
    collision.set_world(&[Obstacle { name: "table".to_owned(), shape, pose_in_base: Pose::translation(0.8, 0.0, 0.73) }], None);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let chain = &group.chain;
    let keep_axes: Vec<KeepAxis> = (0..if tilt_deg.is_some() { chain.n_tips() } else { 0 })
        .map(|tip_idx| KeepAxis {
            tip_idx,
            axis_in_tip: chain.fk_of(tip_idx, &group.home_q).rotation.inverse() * Vector3::z_axis(),
            direction_in_base: Vector3::z_axis(),
            max_angle_rad: tilt_deg.unwrap_or(180.0).to_radians(),
        })
        .collect();
    let is_over_the_table = |tip: usize, q: &[f64]| {
        let at = chain.fk_of(tip, q).translation.vector;
        let is_over = (0.45..0.9).contains(&at.x) && at.y.abs() < 0.5 && (0.8..1.2).contains(&at.z);
        is_over && keep_axes.get(tip).is_none_or(|keep| keep.holds(chain, q))
    };
    let mut draw = || loop {
        // The joints that only one arm has are drawn until its palm is over the table; the torso once.
        let mut q = random_q(chain, &mut rng);
        for tip in 0..chain.n_tips() {
            for _ in 0..1_000_000 {
                if is_over_the_table(tip, &q) {
                    break;
                }
                let other = random_q(chain, &mut rng);
                let is_own = |idx: &usize| (0..chain.n_tips()).all(|any| chain.moves_tip(*idx, any) == (any == tip));
                (0..q.len()).filter(is_own).for_each(|idx| q[idx] = other[idx]);
            }
        }
        if (0..chain.n_tips()).all(|tip| is_over_the_table(tip, &q)) && collision.is_free(&q) {
            return q;
        }
    };
    let pairs: Vec<_> = (0..n).map(|_| (draw(), draw())).collect();
    let planner = RrtConnect { settings: RrtSettings { keep_axes: keep_axes.clone(), ..RrtSettings::default() } };
    let (mut times, mut n_direct, mut n_solved, mut n_corners) = (Vec::new(), 0, 0, 0);
    for (idx, (start, goal)) in pairs.iter().enumerate() {
        let solve = || {
            let begin = Instant::now();
            let outcome = planner.plan(&collision, start, std::slice::from_ref(goal), idx as u64);
            (begin.elapsed().as_secs_f64() * 1e3, outcome)
        };
        // The least of three, as other work may come between.
        let (first, outcome) = solve();
        times.push(first.min(solve().0).min(solve().0));
        if let PlanOutcome::Found(path) = outcome {
            assert!(path.windows(2).all(|pair| keep_axes.iter().all(|keep| keep.holds_between(
                chain,
                &pair[0],
                &pair[1],
                1.0 / 512.0
            ))));
            n_solved += 1;
            n_direct += usize::from(path.len() == 2);
            n_corners += path.len() - 2;
        }
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    let (median, p95, max) = (at(0.5), at(0.95), at(1.0));
    let tilt = tilt_deg.map(|tilt| format!(" within {tilt} degrees")).unwrap_or_default();
    println!(
        "{name}{tilt}: {n_solved}/{n} solved ({n_direct} straight, {n_corners} corners in all); \
         median {median:.2} ms, p95 {p95:.1} ms, max {max:.0} ms"
    );
}
