//! Reading a hand profile and finding what is wrong with it.

use sfg_types::{GraspType, HandProfile};
use std::path::{Path, PathBuf};

/// Why a profile cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProfileError {
    /// The file cannot be read.
    #[error("cannot read hand profile {path:?}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is no profile.
    #[error("hand profile {path:?}: {message}")]
    Yaml {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        message: String,
    },
    /// The values contradict each other.
    #[error("hand profile {name:?}: {message}")]
    Invalid {
        /// Name of the hand.
        name: String,
        /// Key, value, what was expected.
        message: String,
    },
}

/// The checked profile in the file at `path`.
///
/// # Errors
/// [`ProfileError`] naming the file and the key.
pub fn load_profile(path: &Path) -> Result<HandProfile, ProfileError> {
    let text = std::fs::read_to_string(path).map_err(|source| ProfileError::Read { path: path.to_owned(), source })?;
    let profile: HandProfile = serde_saphyr::from_str(&text)
        .map_err(|error| ProfileError::Yaml { path: path.to_owned(), message: error.to_string() })?;
    validate(&profile)?;
    Ok(profile)
}

/// Checks that the values of a profile fit each other.
///
/// # Errors
/// [`ProfileError::Invalid`] for the first contradiction.
pub fn validate(profile: &HandProfile) -> Result<(), ProfileError> {
    let check = |holds: bool, message: &dyn Fn() -> String| {
        if holds { Ok(()) } else { Err(ProfileError::Invalid { name: profile.name.clone(), message: message() }) }
    };
    for joint in &profile.joints {
        let name = &joint.name;
        check(joint.lower_rad < joint.upper_rad, &|| {
            format!("joint {name:?}: lower_rad {} is not below upper_rad {}", joint.lower_rad, joint.upper_rad)
        })?;
        check(joint.stiffness_nm_per_rad > 0.0 && joint.damping_nms_per_rad >= 0.0 && joint.max_torque_nm > 0.0, &|| {
            format!("joint {name:?}: stiffness and torque must be positive, damping not negative")
        })?;
    }
    check(!profile.synergy_joints.is_empty(), &|| "synergy_joints is empty".to_owned())?;
    for name in &profile.synergy_joints {
        check(profile.joints.iter().any(|joint| joint.name == *name), &|| {
            format!("synergy_joints: {name:?} is no joint of the hand")
        })?;
    }
    let (n_rows, n_joints) = (profile.synergy_matrix.len(), profile.synergy_joints.len());
    check(n_rows == n_joints, &|| format!("synergy_matrix has {n_rows} rows for {n_joints} synergy_joints"))?;
    let dot: f64 = profile.synergy_matrix.iter().map(|[m1, m2]| m1 * m2).sum();
    check(dot.abs() < 1e-6, &|| format!("synergy_matrix: its columns are not orthogonal, their product is {dot}"))?;
    let has_length = |column: usize| profile.synergy_matrix.iter().any(|row| row[column] != 0.0);
    check(has_length(0) && has_length(1), &|| "synergy_matrix: a column is zero".to_owned())?;
    for kind in GraspType::ALL {
        let Some(entry) = profile.grasp_types.get(&kind) else {
            return check(false, &|| format!("grasp_types: {kind} is missing"));
        };
        let c = entry.c_tar;
        check((0.0..=1.0).contains(&c.c1) && (-1.0..=1.0).contains(&c.c2), &|| {
            format!("grasp_types: c_tar ({}, {}) of {kind} is outside [0, 1] x [-1, 1]", c.c1, c.c2)
        })?;
        check(0.0 <= entry.standoff_min_m && entry.standoff_min_m <= entry.standoff_max_m, &|| {
            format!("grasp_types: stand-off of {kind} is not 0 <= min <= max")
        })?;
    }
    let positive = [
        ("max_tension_nm", profile.max_tension_nm),
        ("tendon_stiffness_nm_per_rad", profile.tendon_stiffness_nm_per_rad),
        ("max_current_amps", profile.max_current_amps),
        ("max_closing_speed_per_sec", profile.max_closing_speed_per_sec),
    ];
    for (key, value) in positive {
        check(value > 0.0 && value.is_finite(), &|| format!("{key} is {value}, it must be positive"))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn shipped() -> HandProfile {
        load_profile(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/softhand2.yaml")).unwrap()
    }

    #[track_caller]
    fn check(spoil: impl FnOnce(&mut HandProfile), expected: &str) {
        let mut profile = shipped();
        spoil(&mut profile);
        let message = validate(&profile).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }

    #[test]
    fn each_contradiction_is_named() {
        check(|profile| profile.joints[3].lower_rad = 9.0, "index_abduction");
        check(|profile| profile.synergy_joints[0] = "tail".into(), "\"tail\" is no joint");
        check(|profile| profile.synergy_matrix.truncate(14), "14 rows for 15");
        check(|profile| profile.synergy_matrix[0][1] = 0.0, "not orthogonal");
        check(|profile| profile.grasp_types.retain(|kind, _| *kind != GraspType::Tripod), "tripod is missing");
        check(|profile| profile.max_tension_nm = f64::NAN, "max_tension_nm");
    }

    #[test]
    fn a_missing_file_is_named() {
        let message = load_profile(Path::new("no/such.yaml")).unwrap_err().to_string();
        assert!(message.contains("no/such.yaml"), "{message}");
    }
}
