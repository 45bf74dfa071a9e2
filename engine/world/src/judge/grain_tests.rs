//! Where grains are: nothing done, a near miss, a full pour, grains still falling, grains on the table.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::Predicate;
use crate::{ObjectSpec, SceneSpec, World, load_object_model};
use rapier3d::prelude::Vector;
use sfg_kinematics::RobotModel;
use sfg_types::{HandCommand, HandSide, RobotCommand};
use std::path::Path;

const N_GRAINS: usize = 30;
/// Over the bowl, and over the bare table.
const BOWL: [f32; 2] = [0.9, -0.3];
const TABLE: [f32; 2] = [0.9, -0.6];

struct Pour {
    world: World,
    command: RobotCommand,
}

impl Pour {
    fn start() -> Self {
        let scenarios = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios");
        let robot = RobotModel::load(&scenarios.join("robots/curi.yaml")).unwrap();
        let object = |name: &str, x_m, y_m| {
            let model = load_object_model(&scenarios.join(format!("objects/{name}.yaml"))).unwrap();
            ObjectSpec::from_model(name, &model, [0.5; 3], x_m, y_m, 0.0).unwrap()
        };
        let objects = vec![object("bottle", 0.9, 0.4).with_grains(N_GRAINS), object("bowl", 0.9, -0.3)];
        let world = World::new(&SceneSpec { objects, seed: 9, ..SceneSpec::default() }, &robot, HandSide::Left).unwrap();
        let q = robot.left.home_q.clone();
        let command = RobotCommand { side: HandSide::Left, dq: vec![0.0; q.len()], q, hand: HandCommand::default() };
        Self { world, command }
    }

    /// Sets grains in layers of nine over a place: magic, so the run is a tampered one, but the predicates must still be right.
    fn put(&mut self, grains: std::ops::Range<usize>, [x, y]: [f32; 2]) {
        for (nth, grain_idx) in grains.enumerate() {
            let (column, row, layer) = (nth % 3, nth / 3 % 3, nth / 9);
            let offset = |i: usize| (i as f32 - 1.0) * 0.012;
            let at = Vector::new(x + offset(column), y + offset(row), 0.79 + 0.012 * layer as f32);
            let body = self.world.bodies.grains[grain_idx].body;
            self.world.bodies.physics.bodies[body].set_translation(at, true);
        }
    }

    fn wait(&mut self, secs: f64) {
        for _ in 0..(secs / World::PERIOD_SECS) as usize {
            self.world.step(&self.command).unwrap();
        }
    }

    #[track_caller]
    fn check(&self, grains_in_bowl: f64, spilled: f64) {
        let ask = |predicate| self.world.verdict(&[predicate]).unwrap().checks.remove(0);
        let at_least = 0.8;
        let inside = ask(Predicate::GrainsIn { container: "bowl".to_owned(), at_least });
        assert!((inside.value.unwrap() - grains_in_bowl).abs() < 0.5 / N_GRAINS as f64, "{inside:?}");
        assert_eq!(inside.pass, grains_in_bowl >= at_least);
        for container in [None, Some("bowl".to_owned())] {
            let outside = ask(Predicate::SpilledAtMost { fraction: 0.1, container });
            assert!((outside.value.unwrap() - spilled).abs() < 0.5 / N_GRAINS as f64, "{outside:?}");
            assert_eq!(outside.pass, spilled <= 0.1);
        }
    }
}

#[test]
fn nothing_done_is_nothing_poured() {
    let mut pour = Pour::start();
    pour.wait(0.2);
    pour.check(0.0, 0.0);
    assert_eq!(pour.world.tampered(), None);
}

#[test]
fn a_near_miss_is_a_miss_and_one_grain_more_is_none() {
    let mut pour = Pour::start();
    pour.put(0..23, BOWL);
    pour.wait(0.04);
    pour.check(0.0, 0.0); // falling between the bowl's walls: neither at rest nor spilled
    pour.wait(1.5);
    pour.check(23.0 / 30.0, 0.0);
    pour.put(23..24, BOWL);
    pour.wait(1.5);
    pour.check(24.0 / 30.0, 0.0);
}

#[test]
fn grains_on_the_table_are_spilled() {
    let mut pour = Pour::start();
    pour.put(0..27, BOWL);
    pour.put(27..30, TABLE);
    pour.wait(1.5);
    pour.check(27.0 / 30.0, 3.0 / 30.0);
    pour.put(26..30, TABLE);
    pour.wait(1.5);
    pour.check(26.0 / 30.0, 4.0 / 30.0);
}
