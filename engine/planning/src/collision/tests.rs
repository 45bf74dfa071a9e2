#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
use super::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use std::path::Path;

#[test]
fn eight_at_once_give_the_verdict_of_one_by_one() {
    let model = RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap();
    let mut collision = CollisionModel::new(&model, HandSide::Left, &model.home_q, CollisionSettings::default()).unwrap();
    let cuboid = Shape::Cuboid { half_extents_m: sfg_types::Vector::new(0.35, 0.7, 0.02) };
    let place = |name: &str, shape: Shape, x: f64, y: f64, z: f64| Obstacle {
        name: name.to_owned(),
        shape,
        pose_in_base: Pose::new(sfg_types::Vector::new(x, y, z), sfg_types::Vector::new(0.3, 0.1, -0.4)),
    };
    let cylinder = Shape::Cylinder { radius_m: 0.05, half_length_m: 0.12 };
    let capsule = Shape::Capsule { radius_m: 0.04, half_length_m: 0.1 };
    let obstacles = [
        place("table", cuboid, 0.8, 0.0, 0.73),
        place("can", cylinder, 0.7, 0.3, 0.9),
        place("rod", capsule, 0.6, 0.4, 1.2),
        place("ball", Shape::Sphere { radius_m: 0.1 }, 0.5, 0.6, 1.0),
    ];
    collision.set_world(&obstacles, None);
    collision.attach("cup", &[(Point::new(0.05, 0.0, 0.05), 0.04)]);
    collision.allow(BodyGroup::Hand, "can");
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut n_free = 0;
    for _ in 0..20_000 {
        let q = random_q(collision.chain(), &mut rng);
        let exact = collision.scan(&q, false);
        let is_free = collision.is_free_between(&q, &q, 1.0);
        n_free += usize::from(is_free);
        let is_clear_cut = exact.as_ref().is_none_or(|contact| contact.depth_m > 1e-6);
        assert!(is_free == exact.is_none() || !is_clear_cut, "{q:?}: {exact:?} and free {is_free}");
    }
    assert!((2_000..18_000).contains(&n_free), "{n_free} of 20000 free");
}
