//! The rotations of every voxel: 48, well spread over all rotations.

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

/// Rotations in a voxel; as many fit into one word.
pub(crate) const N_ROTATIONS: usize = 48;

/// Six rotations (x, y, z, w) found by a random search for the least gap; the eight turns of a square prism about the
/// shoulder's axis make 48 of them.
///
/// No rotation is farther than 51.3 degrees from its nearest; the 24 turns of a cube leave 62.8 degrees, and the 60 of an
/// icosahedron 44.5.
const SIX_XYZW: [[f64; 4]; 6] = [
    [-0.029359, -0.793516, 0.566319, 0.220801],
    [-0.307610, 0.526335, -0.256694, 0.749970],
    [0.256867, 0.018788, -0.913825, 0.313992],
    [-0.365320, 0.126176, -0.701969, 0.598215],
    [-0.632357, -0.127990, -0.712116, 0.276830],
    [-0.031811, 0.945430, -0.218089, 0.239972],
];

/// All 48, seen from the shoulder frame.
pub(crate) fn rotations() -> Vec<UnitQuaternion<f64>> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let turns = (0..8).map(|turn: u32| {
        let about_z = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), quarter * f64::from(turn % 4));
        let about_x = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 2.0 * quarter * f64::from(turn / 4));
        about_z * about_x
    });
    turns.flat_map(|turn| SIX_XYZW.map(|[x, y, z, w]| turn * Unit::new_normalize(Quaternion::new(w, x, y, z)))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn no_rotation_is_far_from_its_nearest() {
        let all = rotations();
        assert_eq!(all.len(), N_ROTATIONS);
        let gap = |to: &UnitQuaternion<f64>| all.iter().map(|one| one.angle_to(to)).fold(f64::INFINITY, f64::min);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut worst = (0.0, UnitQuaternion::identity());
        for n in 0..20_000 {
            // First anywhere, then about the worst so far.
            let step = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)) * if n < 10_000 { 4.0 } else { 0.05 };
            let at = UnitQuaternion::from_scaled_axis(step) * if n < 10_000 { UnitQuaternion::identity() } else { worst.1 };
            let found = gap(&at);
            if found > worst.0 {
                worst = (found, at);
            }
        }
        let degrees = worst.0.to_degrees();
        assert!((49.0..51.3).contains(&degrees), "{degrees}");
    }
}
