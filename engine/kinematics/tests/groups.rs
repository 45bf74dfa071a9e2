//! Arms that branch: both arms and the torso as one chain with two tips.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and say what they pass over")]

use nalgebra::Vector6;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::robot::GROUPS;
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, RobotModel, Tree};
use sfg_types::{HandSide, Pose};
use std::path::Path;

fn curi() -> RobotModel {
    RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap()
}

#[track_caller]
fn assert_near(a: &Pose, b: &Pose, tolerance: f64) {
    let metres = (a.translation.vector - b.translation.vector).norm();
    let radians = a.rotation.angle_to(&b.rotation);
    assert!(metres < tolerance && radians < tolerance, "{metres:e} m, {radians:e} rad apart");
}

/// Links, the torso's coupled bars among them, and tips against the tree.
#[test]
fn every_link_and_tip_is_where_the_tree_has_it() {
    let model = curi();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for (name, n_joints, n_links) in [
        ("left", 7, 7),
        ("right", 7, 7),
        ("both", 14, 14),
        ("torso_left", 10, 14),
        ("torso_right", 10, 14),
        ("torso_both", 17, 21),
    ] {
        let group = model.group(name).unwrap();
        assert_eq!((group.chain.n_joints(), group.chain.link_names.len()), (n_joints, n_links), "{name}");
        for _ in 0..100 {
            let q = random_q(&group.chain, &mut rng);
            let poses = model.link_poses(&model.q_with_group(&group, &q));
            let all = group.chain.fk_all(&q);
            let names = group.chain.link_names.iter().chain(&group.chain.tip_names);
            assert_eq!(all.len(), n_links + group.chain.n_tips());
            for (name, pose) in names.zip(&all) {
                assert_near(pose, &poses[model.tree.link_idx(name).unwrap()], 1e-9);
            }
            for tip in 0..group.chain.n_tips() {
                assert_near(&group.chain.fk_of(tip, &q), &all[n_links + tip], 1e-12);
            }
        }
    }
}

#[test]
fn a_group_of_one_arm_is_that_arm() {
    let model = curi();
    for (name, side) in [("left", HandSide::Left), ("right", HandSide::Right)] {
        let (group, arm) = (model.group(name).unwrap(), model.arm(side));
        assert_eq!((&group.chain, &group.q_idx, &group.home_q), (&arm.chain, &arm.q_idx, &arm.home_q));
    }
    let message = model.group("torso_lft").unwrap_err().to_string();
    assert!(message.contains("no group") && message.contains("\"torso_left\""), "{message}");
    assert_eq!(GROUPS.map(|name| model.group(name).unwrap().hand_root_links.len()), [1, 1, 2, 1, 1, 2]);
}

#[track_caller]
fn check_jacobian(chain: &Chain, tip: usize, q: &[f64]) {
    let h = 1e-6;
    let jacobian = chain.jacobian_of(tip, q);
    for joint in 0..chain.n_joints() {
        let moved = |step: f64| {
            let mut q = q.to_vec();
            q[joint] += step;
            chain.fk_of(tip, &q)
        };
        let (a, b) = (moved(-h), moved(h));
        let linear = (b.translation.vector - a.translation.vector) / (2.0 * h);
        let angular = (b.rotation * a.rotation.inverse()).scaled_axis() / (2.0 * h);
        let numeric = Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
        let difference = (jacobian.column(joint) - numeric).abs().max();
        assert!(difference < 1e-7, "joint {joint} of tip {tip}: {difference:e}");
        assert_eq!(chain.moves_tip(joint, tip), jacobian.column(joint).norm() > 0.0);
    }
}

#[test]
fn the_jacobian_of_each_tip_is_the_derivative_of_its_pose() {
    let model = curi();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for name in ["both", "torso_right", "torso_both"] {
        let chain = model.group(name).unwrap().chain;
        for _ in 0..30 {
            let q = random_q(&chain, &mut rng);
            (0..chain.n_tips()).for_each(|tip| check_jacobian(&chain, tip, &q));
        }
    }
}

#[test]
fn the_torso_adds_to_an_arms_manipulability() {
    let model = curi();
    let (both, all) = (model.group("both").unwrap(), model.group("torso_both").unwrap());
    for (tip, arm) in [&model.left, &model.right].into_iter().enumerate() {
        let alone = arm.chain.manipulability(&arm.home_q);
        assert!((both.chain.manipulability_of(tip, &both.home_q) - alone).abs() < 1e-12);
        assert!(all.chain.manipulability_of(tip, &all.home_q) > alone + 1e-3);
    }
}

#[test]
fn joints_that_mimic_move_with_the_joint_that_they_follow() {
    let link = |name: &str| format!("<link name='{name}'/>");
    let joint = |name: &str, kind: &str, parent: &str, child: &str, mimic: &str| {
        format!(
            "<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/><origin xyz='0.1 0 0' rpy='0.4 0 0.2'/>\
             <axis xyz='0 1 1'/><limit lower='-1' upper='1' velocity='1' effort='1'/>{mimic}</joint>"
        )
    };
    let parts = [
        ["base", "motor", "knuckle", "slide", "tip", "beside"].map(link).concat(),
        joint("a", "revolute", "base", "motor", ""),
        joint("b", "revolute", "motor", "knuckle", "<mimic joint='a' multiplier='-0.5' offset='0.2'/>"),
        joint("c", "prismatic", "knuckle", "slide", "<mimic joint='b' multiplier='0.3'/>"),
        joint("d", "revolute", "slide", "tip", ""),
        joint("e", "revolute", "base", "beside", "<mimic joint='d' multiplier='2'/>"),
    ];
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("finger.urdf");
    std::fs::write(&path, format!("<robot name='finger'>{}</robot>", parts.concat())).unwrap();
    let tree = Tree::load(&path).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let all = Chain::between(&tree, "base", "tip", &[0.0; 2]).unwrap();
    assert_eq!(
        (all.joint_names.join(" "), all.link_names.join(" ")),
        ("a d".to_owned(), "motor knuckle slide tip beside".to_owned())
    );
    for _ in 0..20 {
        let q = random_q(&all, &mut rng);
        let poses = tree.link_poses(&q);
        for (name, pose) in all.link_names.iter().zip(all.fk_all(&q)) {
            assert_near(&pose, &poses[tree.link_idx(name).unwrap()], 1e-12);
        }
        check_jacobian(&all, 0, &q);
        // From the motor on, two joints are moved by one that lies before the base.
        let after = Chain::between(&tree, "motor", "slide", &[0.0; 2]).unwrap();
        assert_eq!(after.joint_names, ["a"]);
        check_jacobian(&after, 0, &q[..1]);
        let at = |name: &str| poses[tree.link_idx(name).unwrap()];
        assert_near(&after.fk(&q[..1]), &(at("motor").inverse() * at("slide")), 1e-12);
    }
}

/// Random reachable pairs of palm poses; every solution is checked against the tree.
#[test]
fn both_palms_are_brought_to_their_poses_at_once() {
    let model = curi();
    for (name, least) in [("torso_left", 100), ("both", 99), ("torso_both", 99)] {
        let group = model.group(name).unwrap();
        let chain = &group.chain;
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut n_solved = 0;
        for _ in 0..100 {
            let truth = random_q(chain, &mut rng);
            let targets: Vec<Pose> = (0..chain.n_tips()).map(|tip| chain.fk_of(tip, &truth)).collect();
            let seed_q = random_q(chain, &mut rng);
            if let IkOutcome::Solved { q, .. } = IkSolver::solve_tips(chain, &targets, &seed_q, &IkSettings::default(), &mut rng)
            {
                n_solved += 1;
                assert!(chain.is_inside_limits(&q, 0.0));
                let poses = model.link_poses(&model.q_with_group(&group, &q));
                for (name, target) in chain.tip_names.iter().zip(&targets) {
                    assert_near(&poses[model.tree.link_idx(name).unwrap()], target, 1.01e-5);
                }
            }
        }
        assert!(n_solved >= least, "{name}: {n_solved} of 100");
    }
}

#[test]
fn one_palm_out_of_reach_fails_with_its_miss() {
    let model = curi();
    for name in ["both", "torso_both"] {
        let chain = model.group(name).unwrap().chain;
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let home = model.group(name).unwrap().home_q;
        let targets = [chain.fk_of(0, &home), Pose::translation(4.0, 0.0, 1.0)];
        let settings = IkSettings { max_starts: 10, ..IkSettings::default() };
        match IkSolver::solve_tips(&chain, &targets, &home, &settings, &mut rng) {
            IkOutcome::Failed { best_q, position_miss_m, .. } => {
                let misses =
                    [0, 1].map(|tip| (chain.fk_of(tip, &best_q).translation.vector - targets[tip].translation.vector).norm());
                assert!((position_miss_m - misses[0].max(misses[1])).abs() < 1e-9, "{name}: {position_miss_m} of {misses:?}");
                assert!(misses[1] > 2.0 && (name != "both" || misses[0] < 1e-5), "{name}: {misses:?}");
            }
            IkOutcome::Solved { q, .. } => panic!("solved by {q:?}"),
        }
    }
}

#[test]
fn posture_and_several_solutions_work_for_two_tips() {
    let model = curi();
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    for name in ["both", "torso_both"] {
        let group = model.group(name).unwrap();
        let chain = &group.chain;
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let (mut plain, mut drawn) = (0.0, 0.0);
        for _ in 0..20 {
            let mut truth = group.home_q.clone();
            truth.iter_mut().zip(random_q(chain, &mut rng)).for_each(|(q, random)| *q += 0.3 * (random - *q));
            chain.clamp(&mut truth);
            let targets = [chain.fk_of(0, &truth), chain.fk_of(1, &truth)];
            let seed_q = random_q(chain, &mut rng);
            let with_posture = IkSettings { posture_q: Some(group.home_q.clone()), ..IkSettings::default() };
            for (settings, sum) in [(IkSettings::default(), &mut plain), (with_posture, &mut drawn)] {
                let mut rng = ChaCha8Rng::seed_from_u64(7);
                let q = IkSolver::solve_tips(chain, &targets, &seed_q, &settings, &mut rng).solution().unwrap();
                (0..2).for_each(|tip| assert_near(&chain.fk_of(tip, &q), &targets[tip], 1.01e-5));
                *sum += distance(&q, &group.home_q);
            }
            let several = IkSolver::solve_tips_several(chain, &targets, &group.home_q, 6, &IkSettings::default(), &mut rng);
            assert!(several.len() > 1, "{name}: {} solutions", several.len());
            several.iter().for_each(|q| (0..2).for_each(|tip| assert_near(&chain.fk_of(tip, q), &targets[tip], 1.01e-5)));
            let gap = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(
                several.windows(2).all(|w| gap(&w[0], &group.home_q) <= gap(&w[1], &group.home_q) && gap(&w[0], &w[1]) > 0.1)
            );
        }
        assert!(drawn < 0.95 * plain, "{name}: the posture drew by {plain} -> {drawn}");
    }
}

#[test]
fn joints_that_move_no_tip_are_refused() {
    let model = curi();
    let joints = [model.left.chain.joint_names.clone(), model.right.chain.joint_names.clone()].concat();
    let error =
        Chain::branching(&model.tree, &model.tree.links[0].name, &[&model.left.tip_link], &joints, &model.home_q).unwrap_err();
    assert!(error.to_string().contains("over joint panda_right_joint1"), "{error}");
    let error =
        Chain::branching(&model.tree, "panda_left_link0", &[&model.left.tip_link, &model.right.tip_link], &[], &model.home_q);
    assert!(error.unwrap_err().to_string().contains("does not hang on link \"panda_left_link0\""));
}

/// Joints between the root and each leaf of the robots in the shared data, where mimics abound.
#[test]
fn chains_of_other_robots_agree_with_their_trees() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/robots");
    let Ok(folders) = std::fs::read_dir(&dir) else {
        eprintln!("passed over: {} is absent", dir.display());
        return;
    };
    let files = folders.filter_map(|folder| std::fs::read_dir(folder.unwrap().path()).ok()).flatten();
    let urdfs = files.map(|file| file.unwrap().path()).filter(|path| path.extension().is_some_and(|end| end == "urdf"));
    let mut n_robots = 0;
    for path in urdfs {
        n_robots += 1;
        let tree = Tree::load(&path).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let is_leaf = |idx: usize| !tree.joints.iter().any(|joint| joint.parent_idx == idx);
        for leaf in (0..tree.links.len()).filter(|idx| is_leaf(*idx)) {
            let chain = Chain::between(&tree, &tree.links[0].name, &tree.links[leaf].name, &vec![0.0; tree.n_q()]).unwrap();
            let values = random_q(&chain, &mut rng);
            let mut q = vec![0.0; tree.n_q()];
            chain.joint_names.iter().zip(&values).for_each(|(name, value)| q[tree.q_idx(name).unwrap()] = *value);
            assert_near(&chain.fk(&values), &tree.link_poses(&q)[leaf], 1e-9);
        }
    }
    assert!(n_robots > 5, "{n_robots} robots in {}", dir.display());
}
