//! Joint torques against pinocchio's. The files are made by `tests/dynamics_pinocchio.py`.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{Chain, Dynamics, GRAVITY, Payload, RobotModel, Tree};
use sfg_types::{Point, Vector};
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
struct Torques {
    base: String,
    tip: String,
    joints: Vec<String>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    payload_kg: f64,
    centre_in_tip: [f64; 3],
    torques: Vec<f64>,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}

fn check(urdf: &Path, torques: &Path) {
    let tree = Tree::load(urdf).unwrap();
    let file: Torques = serde_json::from_str(&std::fs::read_to_string(torques).unwrap()).unwrap();
    let rest_q = vec![0.0; tree.n_q()];
    let chain = Chain::between(&tree, &file.base, &file.tip, &rest_q).unwrap();
    assert_eq!(chain.joint_names, file.joints);
    let dynamics = Dynamics::new(&tree, &chain, &rest_q).unwrap();
    let mut worst = 0.0_f64;
    for case in &file.cases {
        let payload = Payload { mass_kg: case.payload_kg, centre_in_tip_m: Vector::from(case.centre_in_tip) };
        let ours = dynamics.with_payload(&payload).torques(&case.q, &case.dq, &case.ddq);
        let largest = case.torques.iter().fold(0.0_f64, |most, torque| most.max(torque.abs()));
        let gap = ours.iter().zip(&case.torques).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        worst = worst.max(gap / largest);
    }
    eprintln!("{}: {} states, largest relative difference {worst:.1e}", urdf.display(), file.cases.len());
    assert!(file.cases.len() >= 10 && worst < 1e-9, "{worst:e}");
}

#[test]
fn torques_are_those_of_pinocchio() {
    check(&folder().join("../../scenarios/robots/curi.urdf"), &folder().join("tests/data/curi_torques.json"));
    // With a finger, which slides.
    let panda = folder().join("../../../shared/data/robots/panda/fer_with_hand.urdf");
    if panda.exists() {
        check(&panda, &folder().join("tests/data/fer_torques.json"));
    }
}

#[test]
fn a_resting_arm_holds_the_slope_of_its_potential_energy() {
    let model = RobotModel::load(&folder().join("../../scenarios/robots/curi.yaml")).unwrap();
    let chain = model.arm_chain(sfg_types::HandSide::Left);
    let payload = Payload { mass_kg: 2.0, centre_in_tip_m: Vector::new(0.03, -0.05, 0.08) };
    let dynamics = Dynamics::new(&model.tree, chain, &model.home_q).unwrap().with_payload(&payload);
    let energy = |q: &[f64]| {
        let poses = model.link_poses(&model.q_with_arm(sfg_types::HandSide::Left, q));
        let links = model.tree.links.iter().zip(&poses);
        let of_links: f64 = links.map(|(l, pose)| l.inertial.mass_kg * (pose * l.inertial.link_from_inertia).translation.z).sum();
        let of_payload = payload.mass_kg * (chain.fk(q) * Point::from(payload.centre_in_tip_m)).z;
        GRAVITY * (of_links + of_payload)
    };
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    for _ in 0..20 {
        let (q, rest) = (random_q(chain, &mut rng), vec![0.0; chain.n_joints()]);
        let torques = dynamics.torques(&q, &rest, &rest);
        for (idx, torque) in torques.iter().enumerate() {
            let (mut low, mut high) = (q.clone(), q.clone());
            low[idx] -= 1e-5;
            high[idx] += 1e-5;
            let slope = (energy(&high) - energy(&low)) / 2e-5;
            assert!((slope - torque).abs() < 1e-4, "joint {idx} at {q:?}: {torque} Nm, slope {slope}");
        }
    }
    // A payload that is not there changes nothing.
    let q = random_q(chain, &mut rng);
    let moves: Vec<f64> = (0..chain.n_joints()).map(|_| rng.random_range(-1.0..1.0)).collect();
    let nothing = dynamics.with_payload(&Payload { mass_kg: 0.0, ..payload });
    assert!((dynamics.payload_kg() - 2.0).abs() < 1e-12);
    let gaps = dynamics
        .torques(&q, &moves, &moves)
        .iter()
        .zip(nothing.torques(&q, &moves, &moves))
        .map(|(a, b)| (a - b).abs())
        .sum::<f64>();
    assert!(gaps < 1e-9, "{gaps}");
}
