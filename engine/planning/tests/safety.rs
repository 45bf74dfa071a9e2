//! Commands of all kinds through the safety filter, and an independent look at what was sent.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{RobotModel, Shape};
use sfg_planning::safety::{Breach, PalmBox, audit};
use sfg_planning::{CollisionModel, CollisionSettings, FilterSettings, Limit, Obstacle, SafetyFilter, TimingSettings, retime};
use sfg_types::{HandSide, Pose};
use std::path::Path;

const PERIOD: f64 = 0.001;

fn curi() -> RobotModel {
    RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap()
}

fn world(model: &RobotModel) -> CollisionModel {
    let settings = CollisionSettings { clearance_m: 0.0, self_clearance_m: 0.0, ..CollisionSettings::default() };
    let mut world = CollisionModel::new(model, HandSide::Left, &model.home_q, settings).unwrap();
    let table = Shape::Cuboid { half_extents_m: Vector3::new(0.35, 0.7, 0.02) };
    let post = Shape::Cylinder { radius_m: 0.03, half_length_m: 0.15 };
    let obstacles = [(table, "table", [0.8, 0.0, 0.73]), (post, "post", [0.6, 0.5, 0.9])]
        .map(|(shape, name, [x, y, z])| Obstacle { name: name.to_owned(), shape, pose_in_base: Pose::translation(x, y, z) });
    world.set_world(&obstacles, None);
    world
}

struct Trial {
    log: Vec<Vec<f64>>,
    n_interventions: usize,
    last: Option<Limit>,
}

/// Sends what `source` makes of the period and the position sent before.
fn run(filter: &mut SafetyFilter, start: &[f64], n: usize, mut source: impl FnMut(usize, &[f64]) -> Option<Vec<f64>>) -> Trial {
    let mut log = vec![start.to_vec(); 3];
    let (mut n_interventions, mut last) = (0, None);
    for period in 0..n {
        let before = log.last().unwrap().clone();
        let wanted = source(period, &before);
        let rest = vec![0.0; start.len()];
        let sent = filter.step(wanted.as_ref().map(|q| (q.as_slice(), rest.as_slice())));
        if let Some(found) = sent.intervention {
            n_interventions += 1;
            last = Some(found.limit);
        }
        log.push(sent.q);
    }
    Trial { log, n_interventions, last }
}

fn breaches(trial: &Trial, world: &CollisionModel) -> Vec<Breach> {
    audit(&trial.log, world.chain(), PERIOD, &FilterSettings::default().palm_box, Some(world))
}

fn filter(world: &CollisionModel, q: &[f64]) -> SafetyFilter {
    let mut filter = SafetyFilter::new(world.chain().clone(), q, PERIOD, FilterSettings::default());
    filter.set_world(Some(world.clone()));
    filter
}

#[test]
fn hostile_sources_break_no_limit() {
    let model = curi();
    let world = world(&model);
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let home = model.left.home_q.clone();
    let n = 7;
    for trial in 0..40 {
        let mut filter = filter(&world, &home);
        let goal = random_q(world.chain(), &mut rng);
        let amplitude: Vec<f64> = (0..n).map(|_| rng.random_range(0.0..2.0)).collect();
        let frequency: Vec<f64> = (0..n).map(|_| rng.random_range(0.2..20.0)).collect();
        let drift: Vec<f64> = (0..n).map(|_| rng.random_range(-0.5..0.5)).collect();
        let start = home.clone();
        let done = run(&mut filter, &home, 1500, |period, _| {
            let t = period as f64 * PERIOD;
            match trial % 5 {
                0 => Some(goal.clone()),
                1 => Some((0..n).map(|i| start[i] + amplitude[i] * (frequency[i] * t).sin()).collect()),
                2 => Some((0..n).map(|i| start[i] + drift[i] * t).collect()),
                3 if period % 7 == 3 => None,
                3 => Some(
                    (0..n).map(|i| if period % 90 == 8 { f64::NAN } else { start[i] + (t * 3.0).sin() * amplitude[i] }).collect(),
                ),
                _ => Some((0..n).map(|i| if period / 100 % 2 == 0 { goal[i] } else { start[i] + drift[i] }).collect()),
            }
        });
        let found = breaches(&done, &world);
        assert!(found.is_empty(), "trial {trial}: {found:?}");
        assert!(done.n_interventions > 0 || trial % 5 == 2, "trial {trial}");
    }
}

#[test]
fn a_source_beyond_a_limit_moves_at_nearly_all_of_it() {
    let model = curi();
    let world = world(&model);
    let home = model.left.home_q.clone();
    let mut filter = SafetyFilter::new(world.chain().clone(), &home, PERIOD, FilterSettings::default());
    // Twice as fast as joint 7 may turn, four radians there and back.
    let velocity = world.chain().limits[6].velocity;
    let done = run(&mut filter, &home, 3000, |period, _| {
        let t = period as f64 * PERIOD;
        let turn = (2.0 * velocity * t) % 8.0;
        let mut q = home.clone();
        q[6] = if turn < 4.0 { turn - 2.0 } else { 6.0 - turn };
        Some(q)
    });
    let way: f64 = done.log.windows(2).map(|w| (w[1][6] - w[0][6]).abs()).sum();
    let share = way / (velocity * 3.0);
    eprintln!("{share:.3} of the allowed speed");
    assert!(breaches(&done, &world).is_empty() && share > 0.8, "{share:.3}");
}

#[test]
fn a_hand_pressed_against_the_table_slides_along_it() {
    let model = curi();
    let world = world(&model);
    let home = model.left.home_q.clone();
    let chain = world.chain();
    let mut filter = filter(&world, &home);
    // Straight down with 0.2 m/s from wherever the palm is, and forward.
    let mut wanted = home.clone();
    let start = chain.fk(&home).translation.vector;
    let done = run(&mut filter, &home, 4000, |_, sent| {
        let jacobian = chain.jacobian(sent);
        let push = Vector3::new(0.15, 0.0, -0.2) * PERIOD;
        let twist = nalgebra::DVector::from_column_slice(&[push.x, push.y, push.z, 0.0, 0.0, 0.0]);
        let step = jacobian.clone().svd(true, true).solve(&twist, 1e-3).unwrap();
        wanted = sent.iter().zip(step.iter()).map(|(q, step)| q + step).collect();
        Some(wanted.clone())
    });
    let found = breaches(&done, &world);
    let end = chain.fk(done.log.last().unwrap()).translation.vector;
    eprintln!("palm from {start:.3?} to {end:.3?}, {} interventions, last {:?}", done.n_interventions, done.last);
    assert!(found.is_empty(), "{found:?}");
    assert!(done.n_interventions > 100);
}

#[test]
fn the_palm_stays_in_its_box_and_slides_along_its_walls() {
    let model = curi();
    let world = world(&model);
    let home = model.left.home_q.clone();
    let chain = world.chain().clone();
    let start = chain.fk(&home).translation.vector;
    let palm_box = PalmBox { low_m: [-1.0, -1.0, 0.0], high_m: [start.x + 0.05, 1.2, 2.1] };
    let mut filter = SafetyFilter::new(chain.clone(), &home, PERIOD, FilterSettings { palm_box, ..FilterSettings::default() });
    let speed = 0.2;
    let done = run(&mut filter, &home, 1500, |_, sent| {
        let twist = nalgebra::DVector::from_column_slice(&[speed * PERIOD, 0.0, speed * PERIOD, 0.0, 0.0, 0.0]);
        let step = chain.jacobian(sent).svd(true, true).solve(&twist, 1e-3).unwrap();
        Some(sent.iter().zip(step.iter()).map(|(q, step)| q + step).collect())
    });
    let found = audit(&done.log, &chain, PERIOD, &palm_box, None);
    let end = chain.fk(done.log.last().unwrap()).translation.vector;
    eprintln!("palm from {start:.3?} to {end:.3?}");
    assert!(found.is_empty(), "{found:?}");
    assert!(end.x > start.x + 0.045, "goes to the wall: {end}");
    assert!(end.z > start.z + 0.8 * speed * 1.5, "and along it: {end}");
}

#[test]
fn a_stop_works_from_any_state_and_holds() {
    let model = curi();
    let world = world(&model);
    let home = model.left.home_q.clone();
    let mut filter = filter(&world, &home);
    let mut moving = run(&mut filter, &home, 300, |period, _| Some(home.iter().map(|q| q + 1e-3 * period as f64).collect()));
    filter.stop();
    let stopping = run(&mut filter, moving.log.last().unwrap(), 400, |_, _| Some(home.clone()));
    assert!(filter.is_stopped() && filter.is_at_rest());
    assert_eq!(stopping.last, Some(Limit::Stopped));
    assert_eq!(stopping.log[401], stopping.log[402]);
    moving.log.extend(stopping.log.into_iter().skip(3));
    assert!(breaches(&moving, &world).is_empty());
    filter.reset(moving.log.last().unwrap());
    assert!(!filter.is_stopped());
}

/// One command after the arm stood at home; the limit that it would have broken.
#[track_caller]
fn check_limit(change: impl Fn(&mut Vec<f64>), expected: Option<(&str, Limit)>) {
    let model = curi();
    let home = model.left.home_q.clone();
    let mut filter = SafetyFilter::new(model.left.chain.clone(), &home, 0.004, FilterSettings::default());
    let mut q = home.clone();
    change(&mut q);
    let sent = filter.step(Some((&q, &vec![0.0; q.len()])));
    let found = sent.intervention.as_ref().map(|found| (found.subject.as_str(), found.limit));
    assert_eq!(found, expected, "{sent:?}");
    assert_eq!(expected.is_none(), sent.q == q);
}

#[test]
fn each_limit_is_named() {
    check_limit(|_| (), None);
    check_limit(|q| q[0] += 2e-4, None);
    check_limit(|q| q[0] += 5e-4, Some(("panda_left_joint1", Limit::Acceleration)));
    check_limit(|q| q[0] += 0.02, Some(("panda_left_joint1", Limit::Velocity)));
    check_limit(|q| q[3] = 0.0, Some(("panda_left_joint4", Limit::Position)));
    check_limit(|q| q[3] = f64::NAN, Some(("panda_left_joint4", Limit::NotANumber)));
    check_limit(|q| q[1] = f64::INFINITY, Some(("panda_left_joint2", Limit::NotANumber)));
    check_limit(|q| q.truncate(6), Some(("arm", Limit::Length)));
}

#[test]
fn a_palm_outside_its_box_may_only_come_back() {
    let model = curi();
    let home = model.left.home_q.clone();
    let mut settings = FilterSettings::default();
    settings.palm_box.high_m[2] = 0.5;
    let lifted = |dz: f64| {
        let jacobian = model.left.chain.jacobian(&home);
        let twist = nalgebra::DVector::from_column_slice(&[0.0, 0.0, dz, 0.0, 0.0, 0.0]);
        let step = jacobian.svd(true, true).solve(&twist, 1e-3).unwrap();
        home.iter().zip(step.iter()).map(|(q, step)| q + step).collect::<Vec<f64>>()
    };
    let step = |dz: f64| {
        let mut filter = SafetyFilter::new(model.left.chain.clone(), &home, 0.004, settings.clone());
        filter.step(Some((&lifted(dz), &[0.0; 7]))).intervention
    };
    let found = step(5e-5).unwrap();
    assert_eq!((found.subject.as_str(), found.limit, found.bound, found.unit), ("palm z", Limit::Workspace, 0.5, "m"));
    assert!(found.to_string().starts_with("palm z:"), "{found}");
    assert_eq!(step(-5e-5), None);
}

#[test]
fn timed_motions_pass_unchanged() {
    let model = curi();
    let world = world(&model);
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for trial in 0..5 {
        let goal: Vec<f64> = model.left.home_q.iter().map(|q| q + rng.random_range(-0.3..0.3)).collect();
        let settings = TimingSettings { speed_fraction: 1.0, sample_period_secs: PERIOD, ..TimingSettings::default() };
        let motion = retime(&[model.left.home_q.clone(), goal], &model.left.chain, &settings, None).unwrap();
        let mut filter = SafetyFilter::new(world.chain().clone(), &motion.q[0], PERIOD, FilterSettings::default());
        for (q, dq) in motion.q.iter().zip(&motion.dq).skip(1) {
            let sent = filter.step(Some((q, dq)));
            assert_eq!(sent.intervention, None, "trial {trial}");
            assert!(sent.q.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-9));
            assert_eq!(&sent.dq, dq, "trial {trial}");
        }
    }
}

#[test]
fn a_source_that_begins_with_a_jump_is_met_and_followed() {
    let model = curi();
    let home = model.left.home_q.clone();
    let mut filter = SafetyFilter::new(model.left.chain.clone(), &home, PERIOD, FilterSettings::default());
    let done =
        run(&mut filter, &home, 600, |period, _| Some(home.iter().map(|q| q + 0.01 + 0.3 * period as f64 * PERIOD).collect()));
    assert!((1..500).contains(&done.n_interventions), "{} of 600", done.n_interventions);
    assert!((done.log[602][1] - home[1] - 0.01 - 0.3 * 599.0 * PERIOD).abs() < 1e-12);
}
