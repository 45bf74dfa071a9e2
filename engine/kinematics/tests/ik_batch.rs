//! Inverse kinematics of many targets against one by one.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, RobotModel};
use sfg_types::{HandSide, Pose};
use std::path::Path;

fn left_arm() -> Chain {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml");
    RobotModel::load(&path).unwrap().arm_chain(HandSide::Left).clone()
}

fn largest_gap(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn near_targets_get_near_configurations_whatever_their_order() {
    let chain = left_arm();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (q, end) = (chain.middle(), random_q(&chain, &mut rng));
    // The palm's way between two configurations, its points dealt out of order.
    let on_line = |n: usize| {
        let at: Vec<f64> = q.iter().zip(&end).map(|(from, to)| from + (to - from) * n as f64 / 149.0).collect();
        chain.fk(&at)
    };
    let dealt: Vec<usize> = (0..150).map(|n| n * 67 % 150).collect();
    let targets: Vec<Pose> = dealt.iter().map(|n| on_line(*n)).collect();
    let outcomes = IkSolver::solve_batch(&chain, &targets, &q, &IkSettings::default(), &mut rng);
    let mut in_order: Vec<(usize, Vec<f64>)> =
        dealt.iter().zip(outcomes).map(|(n, outcome)| (*n, outcome.solution().expect("the arm was there"))).collect();
    in_order.sort_by_key(|(n, _)| *n);
    let n_jumps = in_order.windows(2).filter(|pair| largest_gap(&pair[0].1, &pair[1].1) > 0.1).count();
    assert!(n_jumps <= 3, "{n_jumps} of 149 steps jump");
}

#[test]
fn every_solution_reaches_its_own_target_and_as_many_are_solved_as_one_by_one() {
    let chain = left_arm();
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut targets: Vec<Pose> = (0..300).map(|_| chain.fk(&random_q(&chain, &mut rng))).collect();
    // And some out of reach, which must not become seeds.
    targets.extend((0..5).map(|n| Pose::translation(3.0 + f64::from(n), 0.0, 0.0)));
    let settings = IkSettings::default();
    let outcomes = IkSolver::solve_batch(&chain, &targets, &chain.middle(), &settings, &mut rng);
    assert_eq!(outcomes.len(), targets.len());
    let mut n_solved = 0;
    for (target, outcome) in targets.iter().zip(&outcomes) {
        match outcome {
            IkOutcome::Solved { q, .. } => {
                n_solved += 1;
                let miss = target.inverse() * chain.fk(q);
                assert!(miss.translation.vector.norm() < 1.1e-5 && miss.rotation.angle() < 1.1e-5, "{miss}");
                assert!(chain.is_inside_limits(q, 0.0));
            }
            IkOutcome::Failed { position_miss_m, .. } => assert!(target.translation.x < 3.0 || *position_miss_m > 1.0),
        }
    }
    let one_by_one = targets.iter().filter(|target| {
        matches!(IkSolver::solve(&chain, target, &chain.middle(), &settings, &mut rng), IkOutcome::Solved { .. })
    });
    let n_one_by_one = one_by_one.count();
    assert!(n_solved >= n_one_by_one.saturating_sub(2) && n_solved <= 300, "{n_solved} against {n_one_by_one}");
}

#[test]
fn a_seed_at_the_solution_is_taken_and_an_exhausted_budget_reports_the_nearest_miss() {
    let chain = left_arm();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (there, elsewhere) = (random_q(&chain, &mut rng), random_q(&chain, &mut rng));
    let settings = IkSettings { max_starts: 2, ..IkSettings::default() };
    let found = IkSolver::solve_from(&chain, &chain.fk(&there), &[&there], &settings, &mut rng).solution().unwrap();
    assert!(largest_gap(&found, &there) < 1e-9);
    let far = Pose::translation(5.0, 0.0, 0.0);
    let outcome = IkSolver::solve_from(&chain, &far, &[&elsewhere, &there], &settings, &mut rng);
    let IkOutcome::Failed { best_q, position_miss_m, .. } = outcome else { panic!("5 m away is out of reach") };
    let miss_m = (chain.fk(&best_q).translation.vector - far.translation.vector).norm();
    assert!((miss_m - position_miss_m).abs() < 1e-9 && miss_m > 3.0, "{miss_m} {position_miss_m}");
    assert!(IkSolver::solve_batch(&chain, &[], &there, &settings, &mut rng).is_empty());
}
