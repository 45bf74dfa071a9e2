//! The twelve functional grasp types.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Power, precision or between, after the GRASP taxonomy (Feix et al., IEEE THMS 2016).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GraspClass {
    /// The object is held rigidly in the palm.
    Power,
    /// The object is held by the finger pads.
    Precision,
    /// Between the two.
    Intermediate,
}

/// Which surfaces of the hand press against each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Opposition {
    /// Palm against fingers.
    Palm,
    /// Finger pads against thumb pad.
    Pad,
    /// Thumb against the side of the index finger.
    Side,
}

/// A functional grasp type: `g_f^t` of the paper, chosen from the 33 types of Feix et al.
///
/// The paper names its twelve only in figures; the choice is reasoned in `ARCHITECTURE.md`. Where each lies in the synergy
/// plane is a property of a hand, so it stands in the hand profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GraspType {
    /// Feix 1: all fingers around a wide body.
    LargeDiameter,
    /// Feix 3: all fingers around a medium handle.
    MediumWrap,
    /// Feix 2: all fingers around a thin handle.
    SmallDiameter,
    /// Feix 4: wrap with the thumb along the handle.
    AdductedThumb,
    /// Feix 15: fingers as a hook, thumb idle.
    FixedHook,
    /// Feix 17: wrap with the index finger stretched.
    IndexFingerExtension,
    /// Feix 11: fingers around a ball.
    PowerSphere,
    /// Feix 12: finger tips around a disk.
    PrecisionDisk,
    /// Feix 6: four finger tips against the thumb.
    PrismaticFourFinger,
    /// Feix 14: thumb, index and middle.
    Tripod,
    /// Feix 9: thumb and index pads.
    PalmarPinch,
    /// Feix 16: thumb against the side of the index finger.
    Lateral,
}

/// A word that names no grasp type.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown grasp type {0:?}")]
pub struct UnknownGraspType(pub String);

impl GraspType {
    /// All twelve, in the order `t1..t12` used throughout the project; the paper names its own only in figures.
    pub const ALL: [Self; 12] = [
        Self::LargeDiameter,
        Self::MediumWrap,
        Self::SmallDiameter,
        Self::AdductedThumb,
        Self::FixedHook,
        Self::IndexFingerExtension,
        Self::PowerSphere,
        Self::PrecisionDisk,
        Self::PrismaticFourFinger,
        Self::Tripod,
        Self::PalmarPinch,
        Self::Lateral,
    ];

    /// The name in files: `large_diameter`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::LargeDiameter => "large_diameter",
            Self::MediumWrap => "medium_wrap",
            Self::SmallDiameter => "small_diameter",
            Self::AdductedThumb => "adducted_thumb",
            Self::FixedHook => "fixed_hook",
            Self::IndexFingerExtension => "index_finger_extension",
            Self::PowerSphere => "power_sphere",
            Self::PrecisionDisk => "precision_disk",
            Self::PrismaticFourFinger => "prismatic_four_finger",
            Self::Tripod => "tripod",
            Self::PalmarPinch => "palmar_pinch",
            Self::Lateral => "lateral",
        }
    }

    /// Number in the table of Feix et al.
    #[must_use]
    pub fn feix_number(self) -> u8 {
        match self {
            Self::LargeDiameter => 1,
            Self::MediumWrap => 3,
            Self::SmallDiameter => 2,
            Self::AdductedThumb => 4,
            Self::FixedHook => 15,
            Self::IndexFingerExtension => 17,
            Self::PowerSphere => 11,
            Self::PrecisionDisk => 12,
            Self::PrismaticFourFinger => 6,
            Self::Tripod => 14,
            Self::PalmarPinch => 9,
            Self::Lateral => 16,
        }
    }

    /// Power, precision or intermediate.
    #[must_use]
    pub fn class(self) -> GraspClass {
        match self {
            Self::PrecisionDisk | Self::PrismaticFourFinger | Self::Tripod | Self::PalmarPinch => GraspClass::Precision,
            Self::Lateral => GraspClass::Intermediate,
            _ => GraspClass::Power,
        }
    }

    /// The opposing surfaces.
    #[must_use]
    pub fn opposition(self) -> Opposition {
        match self.class() {
            GraspClass::Power => Opposition::Palm,
            GraspClass::Precision => Opposition::Pad,
            GraspClass::Intermediate => Opposition::Side,
        }
    }
}

impl fmt::Display for GraspType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for GraspType {
    type Err = UnknownGraspType;
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|kind| kind.name() == text).ok_or_else(|| UnknownGraspType(text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back_and_taxonomy_numbers_are_distinct() {
        let mut numbers: Vec<u8> = GraspType::ALL.iter().map(|kind| kind.feix_number()).collect();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), 12);
        for kind in GraspType::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        assert!("fist".parse::<GraspType>().is_err());
    }
}
