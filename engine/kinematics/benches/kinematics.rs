//! FK, Jacobian, torques and IK of one Panda arm over 10,000 random reachable poses and of arms with torso over 1000: per-item times,
//! varied inputs, checksum printed.
//!
//! `cargo bench -p sfg-kinematics` writes `target/bench/kinematics.json`.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program")]

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{Chain, Dynamics, IkOutcome, IkSettings, IkSolver, RobotModel};
use sfg_types::Pose;
use std::path::Path;
use std::time::Instant;

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let model = RobotModel::load_without_hands(&root.join("scenarios/robots/curi.yaml")).unwrap();
    let joints = &model.description.arms.left.joints;
    let chain = Chain::new(&model.tree, "panda_left_link0", "panda_left_link7", joints, &model.home_q).unwrap();
    let n = 10_000;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let configurations: Vec<Vec<f64>> = (0..n).map(|_| random_q(&chain, &mut rng)).collect();
    let seeds: Vec<Vec<f64>> = (0..n).map(|_| random_q(&chain, &mut rng)).collect();
    let mut checksum = 0.0;
    let mut rows = Vec::new();

    let fk = measure(&configurations, |q| checksum += chain.fk(q).translation.x);
    rows.push(row("kinematics/fk", "us", fk));
    let jacobian = measure(&configurations, |q| checksum += chain.jacobian(q)[(0, 0)]);
    rows.push(row("kinematics/jacobian", "us", jacobian));
    let dynamics = Dynamics::new(&model.tree, &chain, &model.home_q).unwrap();
    let torques = measure(&configurations, |q| checksum += dynamics.torques(q, q, q)[0]);
    rows.push(row("kinematics/torques", "us", torques));

    let settings = IkSettings::default();
    let mut n_solved = 0;
    let mut case = 0;
    let ik = measure(&configurations, |q| {
        let target = chain.fk(q);
        if let IkOutcome::Solved { q, .. } = IkSolver::solve(&chain, &target, &seeds[case], &settings, &mut rng) {
            n_solved += 1;
            checksum += q[0];
        }
        case += 1;
    });
    let mean = ik.iter().sum::<f64>() / ik.len() as f64;
    let mut ik_row = row("kinematics/ik", "us", ik);
    ik_row["mean"] = mean.into();
    ik_row["solved"] = n_solved.into();
    rows.push(ik_row);
    for (name, half_width_m) in [("kinematics/ik_batch_spread", None), ("kinematics/ik_batch_near", Some(0.2))] {
        rows.extend(batch_rows(&chain, name, half_width_m));
    }
    for name in ["left", "torso_left", "both", "torso_both"] {
        rows.extend(group_rows(&model, name, &mut checksum));
    }
    for row in &rows {
        println!("{row}");
    }
    println!("checksum {checksum:.6}, ik solved {n_solved}/{n}");
    let out = root.join("target/bench");
    std::fs::create_dir_all(&out).unwrap();
    std::fs::write(out.join("kinematics.json"), serde_json::to_string_pretty(&rows).unwrap()).unwrap();
}

/// 2000 reachable poses, anywhere or in a cube in front of the arm: one by one from random configurations, and as a batch.
fn batch_rows(chain: &Chain, name: &str, half_width_m: Option<f64>) -> [serde_json::Value; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let centre = Vector3::new(0.45, 0.0, 0.4);
    let is_inside = |pose: &Pose| half_width_m.is_none_or(|half| (pose.translation.vector - centre).amax() < half);
    let poses: Vec<Pose> = std::iter::repeat_with(|| chain.fk(&random_q(chain, &mut rng))).filter(is_inside).take(2000).collect();
    let settings = IkSettings::default();
    let is_solved = |outcome: &IkOutcome| matches!(outcome, IkOutcome::Solved { .. });
    let repeats = 9;
    let timed = |name: String, solve: &mut dyn FnMut() -> Vec<IkOutcome>| {
        let mut n_solved = 0;
        let times = (0..repeats).map(|_| {
            let start = Instant::now();
            n_solved = solve().iter().filter(|outcome| is_solved(outcome)).count();
            start.elapsed().as_secs_f64() * 1e6 / poses.len() as f64
        });
        let mut row = row(&name, "us", times.collect());
        row["solved"] = n_solved.into();
        row
    };
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let one_by_one = timed(format!("{name}/one_by_one"), &mut || {
        let solve = |pose| IkSolver::solve(chain, pose, &random_q(chain, &mut rng), &settings, &mut rng);
        poses.iter().map(solve).collect()
    });
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let batch =
        timed(format!("{name}/batch"), &mut || IkSolver::solve_batch(chain, &poses, &chain.middle(), &settings, &mut rng));
    [one_by_one, batch]
}

/// Forward kinematics and Jacobians of all tips, and inverse kinematics from a random seed to a random reachable pose of each.
fn group_rows(model: &RobotModel, name: &str, checksum: &mut f64) -> Vec<serde_json::Value> {
    let chain = model.group(name).unwrap().chain;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let configurations: Vec<Vec<f64>> = (0..1000).map(|_| random_q(&chain, &mut rng)).collect();
    let seeds: Vec<Vec<f64>> = (0..1000).map(|_| random_q(&chain, &mut rng)).collect();
    let poses = |q: &[f64]| (0..chain.n_tips()).map(|tip| chain.fk_of(tip, q)).collect::<Vec<_>>();
    let fk = measure(&configurations, |q| *checksum += poses(q)[0].translation.x);
    let jacobian =
        measure(&configurations, |q| (0..chain.n_tips()).for_each(|tip| *checksum += chain.jacobian_of(tip, q)[(0, 0)]));
    let mut solved = Vec::new();
    let settings = IkSettings { max_starts: 1000, ..IkSettings::default() };
    let ik = measure(&configurations, |q| {
        let q = IkSolver::solve_tips(&chain, &poses(q), &seeds[solved.len()], &settings, &mut rng).solution();
        *checksum += q.as_ref().map_or(0.0, |q| q[0]);
        solved.push(q.is_some());
    });
    let mean = ik.iter().sum::<f64>() / ik.len() as f64;
    let solved_within_20_ms = ik.iter().zip(&solved).filter(|(time, solved)| **solved && **time <= 20e3).count();
    let mut ik_row = row(&format!("kinematics/{name}/ik"), "us", ik);
    ik_row["mean"] = mean.into();
    ik_row["solved"] = solved.iter().filter(|solved| **solved).count().into();
    ik_row["solved_within_20_ms"] = solved_within_20_ms.into();
    vec![row(&format!("kinematics/{name}/fk"), "us", fk), row(&format!("kinematics/{name}/jacobian"), "us", jacobian), ik_row]
}

fn measure(inputs: &[Vec<f64>], mut work: impl FnMut(&[f64])) -> Vec<f64> {
    inputs
        .iter()
        .map(|input| {
            let start = Instant::now();
            work(input);
            start.elapsed().as_secs_f64() * 1e6
        })
        .collect()
}

fn row(name: &str, unit: &str, mut times: Vec<f64>) -> serde_json::Value {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    serde_json::json!({"bench": name, "unit": unit, "median": at(0.5), "p95": at(0.95), "max": at(1.0), "n": times.len(), "peer": null})
}
