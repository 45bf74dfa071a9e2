//! What stands on the table, as far as the sensors tell.

use crate::{Point, Vector};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Coarse shape of a cluster, from its points alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShapeClass {
    /// Round cross-section, clearly taller than wide: bottles, cans, glasses.
    UprightCylinder,
    /// Oval or flat cross-section without sharp edges, taller than wide: detergent bottles, flasks.
    UprightOval,
    /// Round and open or flat, wider than tall: bowls, plates, pots.
    WideRound,
    /// Flat faces meeting at right angles.
    Box,
    /// Much longer than thick, lying down: tools, cutlery.
    Elongated,
    /// Compact without a dominant axis.
    Blob,
}

/// Basic colour words, as people use them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "each variant is its own word")]
pub enum ColourName {
    Black,
    Grey,
    White,
    Red,
    Orange,
    Yellow,
    Green,
    Blue,
    Purple,
    Pink,
    Brown,
}

/// A word for a cluster and how well the cluster fits it, 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RankedName {
    /// Object category, lower case.
    pub name: String,
    /// Fit, 0 to 1.
    pub score: f64,
}

/// One thing on the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectCluster {
    /// Number within this inventory, from 0 in order of the centre's x then y.
    pub id: u32,
    /// Extents of the upright bounding box: long horizontal side, short horizontal side, height; metres.
    #[schemars(with = "[f64; 3]")]
    pub size_m: Vector,
    /// Rotation of the long horizontal side about +Z, radians in [-pi/2, pi/2).
    pub yaw_rad: f64,
    /// Centre of the bounding box.
    #[schemars(with = "[f64; 3]")]
    pub centre_in_base: Point,
    /// Dominant colour.
    pub colour: ColourName,
    /// Coarse shape.
    pub shape: ShapeClass,
    /// Likely names, best first.
    pub names: Vec<RankedName>,
    /// Surface points of both views, base frame, metres.
    #[serde(skip)]
    pub points_in_base: Vec<Point3<f32>>,
}

/// Everything on the table: the paper's Environment Information, from sensors only.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneInventory {
    /// The things, by id.
    pub clusters: Vec<ObjectCluster>,
    /// Height of the supporting plane above the base origin, metres.
    pub table_height_m: f64,
}

impl SceneInventory {
    /// The cluster with number `id`.
    #[must_use]
    pub fn cluster(&self, id: u32) -> Option<&ObjectCluster> {
        self.clusters.iter().find(|cluster| cluster.id == id)
    }
}
