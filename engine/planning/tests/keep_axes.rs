//! Full cups: an axis of each palm stays near the vertical along the whole way.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{JointGroup, RobotModel, Shape};
use sfg_planning::{CollisionModel, CollisionSettings, KeepAxis, Obstacle, PlanOutcome, Planner, RrtConnect, RrtSettings};
use sfg_types::Pose;
use std::path::Path;

const TILT_RAD: f64 = 0.2;

struct Bench {
    model: RobotModel,
    group: JointGroup,
    collision: CollisionModel,
    planner: RrtConnect,
}

/// A robot at a table that holds upright in both hands what is upright at home.
fn bench(name: &str) -> Bench {
    let model = RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap();
    let group = model.group(name).unwrap();
    let mut collision = CollisionModel::of_group(&model, &group, &model.home_q, CollisionSettings::default()).unwrap();
    let shape = Shape::Cuboid { half_extents_m: Vector3::new(0.35, 0.7, 0.02) };
    collision.set_world(&[Obstacle { name: "table".to_owned(), shape, pose_in_base: Pose::translation(0.8, 0.0, 0.73) }], None);
    let keep_axes = (0..group.chain.n_tips())
        .map(|tip_idx| KeepAxis {
            tip_idx,
            axis_in_tip: group.chain.fk_of(tip_idx, &group.home_q).rotation.inverse() * Vector3::z_axis(),
            direction_in_base: Vector3::z_axis(),
            max_angle_rad: TILT_RAD,
        })
        .collect();
    let planner = RrtConnect { settings: RrtSettings { keep_axes, ..RrtSettings::default() } };
    Bench { model, group, collision, planner }
}

impl Bench {
    /// The largest angle along a path, from the poses of the whole tree's links.
    fn largest_tilt(&self, path: &[Vec<f64>]) -> f64 {
        let mut largest: f64 = 0.0;
        let tips: Vec<usize> = self.group.chain.tip_names.iter().map(|name| self.model.tree.link_idx(name).unwrap()).collect();
        for pair in path.windows(2) {
            let length = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let n = (length * 200.0).ceil().max(1.0) as usize;
            for i in 0..=n {
                let q: Vec<f64> = pair[0].iter().zip(&pair[1]).map(|(a, b)| a + i as f64 / n as f64 * (b - a)).collect();
                let poses = self.model.link_poses(&self.model.q_with_group(&self.group, &q));
                for (tip, keep) in tips.iter().zip(&self.planner.settings.keep_axes) {
                    largest = largest.max((poses[*tip].rotation * keep.axis_in_tip).z.clamp(-1.0, 1.0).acos());
                }
            }
        }
        largest
    }

    /// A free configuration with upright palms that are over the table.
    fn upright(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let chain = &self.group.chain;
        loop {
            let mut q = self.group.home_q.clone();
            for keep in &self.planner.settings.keep_axes {
                loop {
                    let other = random_q(chain, rng);
                    (0..q.len()).filter(|idx| chain.moves_tip(*idx, keep.tip_idx)).for_each(|idx| q[idx] = other[idx]);
                    let at = chain.fk_of(keep.tip_idx, &q).translation;
                    if keep.holds(chain, &q) && (0.4..0.9).contains(&at.x) && at.z > 0.8 {
                        break;
                    }
                }
            }
            if self.collision.is_free(&q) {
                return q;
            }
        }
    }
}

#[test]
fn cups_stay_upright_along_the_whole_way() {
    for (name, n) in [("left", 6), ("both", 3)] {
        let bench = bench(name);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut n_tilting = 0;
        for seed in 0..n {
            let (start, goal) = (bench.upright(&mut rng), bench.upright(&mut rng));
            n_tilting += usize::from(bench.largest_tilt(&[start.clone(), goal.clone()]) > TILT_RAD + 0.1);
            let path = match bench.planner.plan(&bench.collision, &start, std::slice::from_ref(&goal), seed) {
                PlanOutcome::Found(path) => path,
                other => panic!("{name}, seed {seed}: {other:?}"),
            };
            let tilt = bench.largest_tilt(&path);
            eprintln!("{name}, seed {seed}: {} corners, at most {tilt:.4} rad", path.len());
            assert!(tilt <= TILT_RAD + 1e-4, "{tilt} rad");
            assert_eq!((path.first(), path.last()), (Some(&start), Some(&goal)));
            assert_eq!(bench.collision.contact_along(&path, 1.0 / 512.0), None);
            assert_eq!(bench.planner.plan(&bench.collision, &start, &[goal], seed), PlanOutcome::Found(path));
        }
        assert!(2 * n_tilting > n as usize, "{name}: only {n_tilting} of {n} straight ways would spill");
    }
}

#[test]
fn ends_that_tilt_are_named() {
    let bench = bench("both");
    let home = bench.group.home_q.clone();
    let mut tilted = home.clone();
    // The last joint of the right arm turns the hand.
    tilted[13] -= 0.5;
    assert_eq!(bench.collision.contact(&tilted), None);
    let plan = |start: &[f64], goals: &[Vec<f64>]| bench.planner.plan(&bench.collision, start, goals, 0);
    let tip = &bench.group.chain.tip_names[1];
    match plan(&tilted, std::slice::from_ref(&home)) {
        PlanOutcome::AxisNotKept { goal_idx: None, tip: found, angle_rad, max_angle_rad } => {
            assert!(found == *tip && angle_rad > TILT_RAD && max_angle_rad == TILT_RAD, "{found} {angle_rad}");
        }
        other => panic!("{other:?}"),
    }
    assert!(matches!(plan(&home, &[tilted.clone()]), PlanOutcome::AxisNotKept { goal_idx: Some(0), .. }));
    // Another goal that does not tilt is enough.
    let mut near = home.clone();
    near[0] -= 0.05;
    let goals = [tilted, near.clone()];
    assert!(matches!(plan(&home, &goals), PlanOutcome::Found(path) if path.last() == Some(&near)));
}
