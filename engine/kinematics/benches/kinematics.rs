//! FK, Jacobian and IK of one Panda arm: per-item times over 10,000 random reachable poses, varied inputs, checksum printed.
//!
//! `cargo bench -p sfg-kinematics` writes `target/bench/kinematics.json`.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program")]

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, RobotModel};
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
    for row in &rows {
        println!("{row}");
    }
    println!("checksum {checksum:.6}, ik solved {n_solved}/{n}");
    let out = root.join("target/bench");
    std::fs::create_dir_all(&out).unwrap();
    std::fs::write(out.join("kinematics.json"), serde_json::to_string_pretty(&rows).unwrap()).unwrap();
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
    serde_json::json!({"bench": name, "unit": unit, "median": at(0.5), "p95": at(0.95), "n": times.len(), "peer": null})
}
