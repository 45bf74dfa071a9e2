//! Names for shapes: a small table of how everyday categories look, and the score of a shape against it.

use crate::shape::Shape;
use serde::Deserialize;
use sfg_types::{RankedName, ShapeClass};
use std::collections::BTreeSet;

/// Names with a lower score are not worth telling.
const MIN_SCORE: f64 = 0.03;
const MAX_NAMES: usize = 6;
/// A wrong yes/no feature leaves this much of the score: the cameras may have missed it.
const WRONG_FEATURE: f64 = 0.30;

/// Which section of a lying thing is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum HandleEnd {
    Thin,
    Thick,
}

/// How one category looks.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Category {
    pub(crate) name: String,
    shapes: Vec<ShapeClass>,
    height_m: [f64; 2],
    width_m: [f64; 2],
    length_m: Option<[f64; 2]>,
    top_ratio: Option<[f64; 2]>,
    hollow: Option<bool>,
    handle_m: Option<[f64; 2]>,
    wide_ratio: Option<[f64; 2]>,
    wide_share: Option<[f64; 2]>,
    pub(crate) handle_end: Option<HandleEnd>,
}

/// The table, as compiled in.
#[derive(Clone, Debug)]
pub(crate) struct Vocabulary {
    categories: Vec<Category>,
}

impl Vocabulary {
    /// Reads the compiled-in table.
    pub(crate) fn embedded() -> Result<Self, String> {
        let categories = serde_saphyr::from_str(include_str!("../vocabulary.yaml")).map_err(|error| error.to_string())?;
        Ok(Self { categories })
    }

    /// How the category `name` looks, if it is in the table.
    pub(crate) fn category(&self, name: &str) -> Option<&Category> {
        self.categories.iter().find(|category| category.name == name)
    }

    /// The names that fit, best first.
    pub(crate) fn names(&self, shape: &Shape) -> Vec<RankedName> {
        let mut names: Vec<RankedName> = self
            .categories
            .iter()
            .map(|category| RankedName { name: category.name.clone(), score: category.score(shape) })
            .filter(|ranked| ranked.score >= MIN_SCORE)
            .collect();
        names.sort_by(|a, b| b.score.total_cmp(&a.score).then_with(|| a.name.cmp(&b.name)));
        // A category that looks different when it lies has two entries.
        let mut seen = BTreeSet::new();
        names.retain(|ranked| seen.insert(ranked.name.clone()));
        names.truncate(MAX_NAMES);
        names
    }
}

impl Category {
    /// 0 to 1; the product of how well each stated feature fits.
    fn score(&self, shape: &Shape) -> f64 {
        let sides = shape.rectangle.sides_m.map(f64::from);
        let mut score = self.shape_score(shape);
        // Sizes of a category have no sharp end: the tolerance grows with the size.
        let size_fit = |value: f64, range: [f64; 2], tolerance: f64| fit(value, range, tolerance + 0.08 * range[1]);
        score *= size_fit(f64::from(shape.height_m()), self.height_m, 0.008);
        score *= size_fit(sides[1], self.width_m, 0.008);
        if let Some(length_m) = self.length_m {
            score *= size_fit(sides[0], length_m, 0.015);
        }
        let optional = [
            (self.top_ratio, Some(f64::from(shape.top_ratio())), 0.06),
            (self.wide_ratio, shape.lengthwise.map(|l| f64::from(l.wide_m / l.thin_m.max(1e-3))), 0.7),
            (self.wide_share, shape.lengthwise.map(|l| f64::from(l.wide_share)), 0.10),
        ];
        for (range, value, tolerance) in optional {
            if let (Some(range), Some(value)) = (range, value) {
                score *= fit(value, range, tolerance);
            }
        }
        if self.hollow.is_some_and(|hollow| hollow != shape.hollow) {
            score *= WRONG_FEATURE;
        }
        if let Some(handle_m) = self.handle_m {
            let reach = f64::from(shape.handle_reach_m);
            score *= if (handle_m[1] > 0.0) == (reach > 0.0) || handle_m[0] == 0.0 && reach == 0.0 {
                size_fit(reach, handle_m, 0.015)
            } else {
                WRONG_FEATURE
            };
        }
        score
    }

    fn shape_score(&self, shape: &Shape) -> f64 {
        use ShapeClass::{Blob, Box, Elongated, UprightCylinder, UprightOval, WideRound};
        if self.shapes.contains(&shape.class) {
            return 1.0;
        }
        // Neighbouring classes differ by a threshold only.
        let kin = |a, b| self.shapes.contains(&a) && shape.class == b;
        if kin(UprightCylinder, WideRound) || kin(WideRound, UprightCylinder) {
            0.5
        } else if kin(UprightCylinder, UprightOval) || kin(UprightOval, UprightCylinder) {
            0.6
        } else if kin(Box, UprightOval) || kin(Box, Blob) || kin(Elongated, Box) || kin(Elongated, Blob) {
            0.3
        } else {
            0.05
        }
    }
}

/// 1 inside `range`, a Gaussian of the miss outside.
fn fit(value: f64, range: [f64; 2], sigma: f64) -> f64 {
    let miss = (range[0] - value).max(value - range[1]).max(0.0);
    (-0.5 * (miss / sigma).powi(2)).exp()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[test]
    fn embedded_table_is_sane() {
        let vocabulary = Vocabulary::embedded().unwrap();
        for category in &vocabulary.categories {
            let ranges =
                [Some(category.height_m), Some(category.width_m), category.length_m, category.top_ratio, category.handle_m];
            for range in ranges.into_iter().flatten() {
                assert!(range[0] <= range[1] && range[0] >= 0.0, "{}: {range:?}", category.name);
            }
            assert!(!category.shapes.is_empty());
            assert_eq!(category.handle_end.is_some(), category.shapes.contains(&ShapeClass::Elongated), "{}", category.name);
            let again = vocabulary.categories.iter().filter(|other| other.name == category.name);
            assert!(again.filter(|other| other.handle_end.is_some() == category.handle_end.is_some()).count() == 1);
        }
        for name in
            ["bottle", "bowl", "mug", "cup", "pitcher", "can", "box", "ball", "hammer", "spatula", "pan", "plate", "screwdriver"]
        {
            assert!(vocabulary.category(name).is_some(), "{name}");
        }
    }
}
