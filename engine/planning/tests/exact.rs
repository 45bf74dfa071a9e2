//! The check by exact geometry finds what is there, and nothing that the covering balls do not touch.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests fail by panicking and tell what they measured")]

use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{RobotModel, Shape};
use sfg_planning::{CollisionModel, CollisionSettings, Obstacle, SelfPairs, verify_tree_exact};
use sfg_types::Pose;
use std::collections::BTreeSet;
use std::path::Path;

#[test]
fn exact_contacts_are_contacts_of_the_balls() {
    let model = RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap();
    let settings = CollisionSettings { clearance_m: 0.0, ..CollisionSettings::default() };
    let hand = model.left.hand_root_link.as_deref();
    let with_pairs = |disabled: &BTreeSet<(String, String)>| {
        let pairs = SelfPairs::AllBut(disabled.clone());
        CollisionModel::of_tree(&model.tree, model.left.chain.clone(), hand, &model.home_q, pairs, settings.clone()).unwrap()
    };
    let exact = |collision: &CollisionModel, pairs: Option<&BTreeSet<(String, String)>>, q: &[f64]| {
        verify_tree_exact(&model.tree, hand, &model.home_q, collision, pairs, &[q.to_vec(), q.to_vec()], 0.1)
    };
    // What touches at home is built so.
    let mut disabled = BTreeSet::new();
    let plain = with_pairs(&disabled);
    while let Some(contact) = exact(&plain, Some(&disabled), &model.left.home_q) {
        assert!(disabled.insert((contact.link.clone(), contact.with.clone())), "{contact} again");
    }
    let mut collision = with_pairs(&disabled);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut n_own, mut n_obstacle) = (0, 0);
    for _ in 0..300 {
        let half = Vector3::from_fn(|_, _| rng.random_range(0.03..0.15));
        let place = Vector3::new(rng.random_range(0.1..0.8), rng.random_range(-0.2..0.8), rng.random_range(0.7..1.6));
        let at = Pose::new(place, Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0)));
        let shape = Shape::Cuboid { half_extents_m: half };
        collision.set_world(&[Obstacle { name: "box".to_owned(), shape, pose_in_base: at }], None);
        let q = random_q(collision.chain(), &mut rng);
        let with_box = exact(&collision, None, &q);
        let with_itself = exact(&collision, Some(&disabled), &q);
        assert!(with_box.as_ref().is_none_or(|contact| contact.with == "box"));
        assert!(with_box.is_none() || with_itself == with_box, "obstacles are looked at first");
        for contact in [&with_box, &with_itself].into_iter().flatten().filter(|contact| contact.depth_m > 1e-5) {
            assert!(!collision.is_free(&q), "{contact} at {q:?}, and no ball touches");
        }
        n_obstacle += usize::from(with_box.is_some());
        n_own += usize::from(with_box.is_none() && with_itself.is_some());
    }
    eprintln!("of 300 random configurations {n_obstacle} touch the box and {n_own} more the robot itself");
    assert!(n_obstacle > 5 && n_own > 20 && n_obstacle + n_own < 295);
}
