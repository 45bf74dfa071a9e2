//! From synergy coordinates to joints and back.

use crate::profile::{ProfileError, validate};
use sfg_types::{GraspClass, GraspType, HandProfile, SynergyCoordinates};

/// Preshape of wraps whose thumb opposes the fingers: thumb 0.6, index 0.35, middle 0.1. The thumb must stand behind the object
/// before the fingers pull, else they push it out past the thumb (cylinders of radius 29-39 mm, simulated, 378 grasps each:
/// 89 % hold from here against 22 % from a hand open at (0.1, 0.1)).
const OPPOSED_PRESHAPE: SynergyCoordinates = SynergyCoordinates::new(0.1, 0.25);
/// Share of `c_tar` kept by other types: an idle or adducted thumb arrives wide open, finger tips arrive half bent.
const POWER_PRESHAPE: f64 = 0.15;
const PRECISION_PRESHAPE: f64 = 0.5;

/// Rows of `M` for each finger.
const JOINTS_PER_FINGER: usize = 3;

/// The two-dimensional synergy space of a hand.
#[derive(Clone, Debug, PartialEq)]
pub struct SynergySpace {
    profile: HandProfile,
    /// Row of `M` for each joint; `None` for joints that `M` leaves out (finger abductions).
    rows: Vec<Option<[f64; 2]>>,
    norms_squared: [f64; 2],
}

impl SynergySpace {
    /// The space of a profile.
    ///
    /// # Errors
    /// [`ProfileError::Invalid`] when the profile contradicts itself.
    pub fn new(profile: &HandProfile) -> Result<Self, ProfileError> {
        validate(profile)?;
        let rows = profile
            .joints
            .iter()
            .map(|joint| {
                let row = profile.synergy_joints.iter().position(|name| *name == joint.name);
                row.map(|row| profile.synergy_matrix[row])
            })
            .collect();
        let norm_squared = |column: usize| profile.synergy_matrix.iter().map(|row| row[column] * row[column]).sum();
        Ok(Self { profile: profile.clone(), rows, norms_squared: [norm_squared(0), norm_squared(1)] })
    }

    /// The profile.
    #[must_use]
    pub fn profile(&self) -> &HandProfile {
        &self.profile
    }

    /// Positions of all joints (19 on the SoftHand2), radians: `q = lower + clip(M c, 0, 1) (upper - lower)`.
    ///
    /// Joints outside `M` follow the first synergy by their tendon ratio, `closing_ratio * c1` radians, within their limits.
    ///
    /// # Source
    /// Equation 12 with the clip of the authors' code; the raw product spans [-2, 3].
    #[must_use]
    pub fn joints_from_synergy(&self, c: SynergyCoordinates) -> Vec<f64> {
        self.profile
            .joints
            .iter()
            .zip(&self.rows)
            .map(|(joint, row)| match row {
                Some([m1, m2]) => {
                    let closure = (m1 * c.c1 + m2 * c.c2).clamp(0.0, 1.0);
                    joint.lower_rad + closure * (joint.upper_rad - joint.lower_rad)
                }
                None => (joint.closing_ratio * c.c1).clamp(joint.lower_rad, joint.upper_rad),
            })
            .collect()
    }

    /// Least-squares coordinates of a hand configuration: `c = M^+ u` with `u` the share of each joint's range (equation 11).
    ///
    /// # Panics
    /// If `joints_rad` has not one value for each joint.
    #[must_use]
    pub fn synergy_from_joints(&self, joints_rad: &[f64]) -> SynergyCoordinates {
        assert_eq!(joints_rad.len(), self.profile.joints.len(), "one value for each hand joint");
        let mut c = [0.0; 2];
        for ((joint, row), value) in self.profile.joints.iter().zip(&self.rows).zip(joints_rad) {
            if let Some(row) = row {
                let closure = (value - joint.lower_rad) / (joint.upper_rad - joint.lower_rad);
                c[0] += row[0] * closure;
                c[1] += row[1] * closure;
            }
        }
        SynergyCoordinates::new(c[0] / self.norms_squared[0], c[1] / self.norms_squared[1])
    }

    /// `c_tar` of a grasp type.
    #[must_use]
    pub fn target(&self, grasp_type: GraspType) -> SynergyCoordinates {
        self.profile.grasp_types[&grasp_type].c_tar
    }

    /// The shape in which the hand arrives: open enough for the object, thumb already opposed where the type opposes it.
    #[must_use]
    pub fn preshape(&self, grasp_type: GraspType) -> SynergyCoordinates {
        let target = self.target(grasp_type);
        match grasp_type.class() {
            GraspClass::Power if target.c2 >= 0.0 => OPPOSED_PRESHAPE,
            GraspClass::Power => SynergyCoordinates::OPEN.lerp(target, POWER_PRESHAPE),
            GraspClass::Precision | GraspClass::Intermediate => SynergyCoordinates::OPEN.lerp(target, PRECISION_PRESHAPE),
        }
    }

    /// Closure of thumb, index, middle, ring and little finger at `c`, each in [0, 1]: the mean over the finger's rows of `M`.
    ///
    /// Fingers follow each other in the rows, three joints each.
    #[must_use]
    pub fn closure(&self, c: SynergyCoordinates) -> [f64; 5] {
        let mut closure = [0.0; 5];
        for (finger, rows) in closure.iter_mut().zip(self.profile.synergy_matrix.chunks(JOINTS_PER_FINGER)) {
            let sum: f64 = rows.iter().map(|[m1, m2]| (m1 * c.c1 + m2 * c.c2).clamp(0.0, 1.0)).sum();
            *finger = sum / rows.len() as f64;
        }
        closure
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::profile::load_profile;
    use std::path::Path;

    fn space() -> SynergySpace {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/softhand2.yaml");
        SynergySpace::new(&load_profile(&path).unwrap()).unwrap()
    }

    #[test]
    fn columns_of_m_are_orthogonal_with_norms_15_and_30() {
        let space = space();
        assert_eq!(space.norms_squared, [15.0, 30.0]);
        let dot: f64 = space.profile.synergy_matrix.iter().map(|row| row[0] * row[1]).sum();
        assert_eq!(dot, 0.0);
    }

    #[test]
    fn pseudo_inverse_undoes_m_where_nothing_clips() {
        let space = space();
        for (c1, c2) in [(0.5, 0.1), (0.3, -0.05), (0.6, 0.15), (0.5, 0.0)] {
            let back = space.synergy_from_joints(&space.joints_from_synergy(SynergyCoordinates::new(c1, c2)));
            assert!((back.c1 - c1).abs() < 1e-12 && (back.c2 - c2).abs() < 1e-12, "{back:?}");
        }
    }

    #[test]
    fn closures_are_clipped_to_the_joint_range() {
        let space = space();
        for (c1, c2) in [(1.0, 1.0), (0.0, -1.0), (0.44, 1.0)] {
            for (joint, q) in space.profile.joints.iter().zip(space.joints_from_synergy(SynergyCoordinates::new(c1, c2))) {
                assert!((joint.lower_rad..=joint.upper_rad).contains(&q), "{} {q}", joint.name);
            }
        }
    }

    fn closures(c1: f64, c2: f64) -> [f64; 5] {
        let space = space();
        space.closure(SynergyCoordinates::new(c1, c2))
    }

    #[test]
    fn the_two_public_anchor_points() {
        assert_eq!(closures(1.0, 0.0), [1.0; 5]);
        assert_eq!(closures(0.44, 1.0), [1.0, 1.0, 0.44, 0.0, 0.0]);
        assert_eq!(space().target(GraspType::SmallDiameter), SynergyCoordinates::new(1.0, 0.0));
        assert_eq!(space().target(GraspType::PalmarPinch), SynergyCoordinates::new(0.44, 1.0));
    }

    #[test]
    fn closures_are_those_of_the_joints() {
        let space = space();
        let c = SynergyCoordinates::new(0.3, 0.08);
        let (closure, q) = (space.closure(c), space.joints_from_synergy(c));
        for (nth, finger) in ["thumb", "index", "middle", "ring", "little"].iter().enumerate() {
            let idx = space.profile.joints.iter().position(|joint| joint.name == format!("{finger}_distal")).unwrap();
            assert!((closure[nth] - q[idx] / space.profile.joints[idx].upper_rad).abs() < 1e-12, "{finger}");
        }
    }

    #[test]
    fn a_preshape_is_more_open_than_its_target() {
        let space = space();
        for kind in GraspType::ALL {
            let (preshape, target) = (space.preshape(kind), space.target(kind));
            assert!(preshape.c1 < target.c1 && preshape.c1 > 0.0, "{kind}");
        }
    }
}
