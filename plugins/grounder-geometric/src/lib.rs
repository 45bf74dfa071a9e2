//! Scene inventory and affordance masks from RGB-D geometry alone.
//!
//! [`GeometricGrounder`] finds the table plane, separates what stands on it, measures each thing (axis of revolution,
//! upright box, hollow or not, handle, head), and ranks names from a small table of how everyday categories look. Parts are
//! found by shape as well: the wide section of a bottle is its body, what sticks out of a mug is its handle. No network, no
//! model of any object, no truth: images and calibration only.

mod cloud;
mod clustering;
mod colour;
mod morphology;
mod parts;
mod round;
mod shape;
#[cfg(test)]
mod synthetic;
mod table;
mod vocabulary;

use cloud::CloudPoint;
use nalgebra::{Point3, Vector3};
use parts::Part;
use sfg_plugin::{AffordanceQuery, Grounder, PluginContext, PluginError, SelfSphere};
use sfg_types::{AffordanceMask, ObjectCluster, Observation, Point, RgbdImage, SceneInventory, ShapeClass, Vector};
use std::collections::HashSet;
use vocabulary::Vocabulary;

/// The name under which scenarios ask for this plugin.
pub const NAME: &str = "geometric";

/// Pixels within this distance of a cluster's points belong to the cluster.
const MEMBERSHIP_M: f32 = 0.006;
/// A part smaller than this many pixels in a view is noise.
const MIN_PART_PIXELS: usize = 25;
/// A mask that covers more of the image than this is no part of a thing on a table.
const MAX_MASK_SHARE: f64 = 0.25;

/// Finds things and their parts by geometry.
#[derive(Clone, Debug)]
pub struct GeometricGrounder {
    vocabulary: Vocabulary,
}

impl GeometricGrounder {
    /// A grounder; it takes no parameters.
    ///
    /// # Errors
    /// [`PluginError::BadParameter`] for any parameter.
    pub fn new(context: &PluginContext<'_>) -> Result<Self, PluginError> {
        let known_empty = context.params.is_null() || context.params.as_object().is_some_and(|params| params.is_empty());
        if !known_empty {
            return Err(PluginError::BadParameter {
                plugin: NAME.to_owned(),
                message: format!("takes no parameters, got {}", context.params),
            });
        }
        Self::with_embedded_vocabulary()
    }

    fn with_embedded_vocabulary() -> Result<Self, PluginError> {
        Ok(Self { vocabulary: Vocabulary::embedded().map_err(|message| failed(&message))? })
    }

    fn describe(&self, points: &[CloudPoint], bottom_z_m: f32) -> Option<ObjectCluster> {
        let mut positions: Vec<Point3<f32>> = points.iter().map(|point| point.position).collect();
        let shape = shape::measure(&positions, bottom_z_m)?;
        if shape.class != ShapeClass::Elongated {
            // At the foot of a standing thing, points near the table may be the table's.
            positions.retain(|p| shape::is_raised(p, bottom_z_m));
        }
        let [long, short] = shape.rectangle.sides_m.map(f64::from);
        let [x, y] = shape.rectangle.centre.map(f64::from);
        let height = f64::from(shape.height_m());
        Some(ObjectCluster {
            id: 0,
            size_m: Vector::new(long, short, height),
            yaw_rad: f64::from(shape.rectangle.yaw_rad),
            centre_in_base: Point::new(x, y, f64::from(shape.bottom_z_m) + height / 2.0),
            colour: colour::dominant_colour(points),
            shape: shape.class,
            names: self.vocabulary.names(&shape),
            points_in_base: positions,
        })
    }
}

impl Grounder for GeometricGrounder {
    /// What stands on the table.
    ///
    /// Round things are reported by their axis: `centre_in_base` is the axis at half height even though only one side is
    /// seen, `size_m` is (diameter + reach of the handle, diameter, height), and `yaw_rad` the direction of the handle.
    /// Things that touch come out as one cluster.
    fn list_scene(&mut self, observation: &Observation, robot: &[SelfSphere]) -> Result<SceneInventory, PluginError> {
        let points = cloud::cloud(observation);
        if points.is_empty() {
            return Err(failed("no view has usable depth"));
        }
        let table =
            table::find_table(&points).ok_or_else(|| failed("no horizontal surface between 0.25 m and 1.30 m was seen"))?;
        let mut clusters: Vec<ObjectCluster> = clustering::clusters(&points, &table, &cloud::RobotBody::new(robot))
            .iter()
            .filter_map(|points| {
                let n = points.len() as f32;
                let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.position.x / n, y + p.position.y / n));
                self.describe(points, table.height_at(x, y))
            })
            .collect();
        clusters.sort_by(|a, b| {
            let (a, b) = (&a.centre_in_base, &b.centre_in_base);
            a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y))
        });
        for (id, cluster) in (0..).zip(&mut clusters) {
            cluster.id = id;
        }
        Ok(SceneInventory { clusters, table_height_m: table.height_m() })
    }

    fn ground(&mut self, query: &AffordanceQuery<'_>, out: &mut [AffordanceMask]) -> Result<(), PluginError> {
        let views = &query.observation.views;
        if views.len() != out.len() {
            return Err(failed(&format!("{} masks were given for {} views", out.len(), views.len())));
        }
        let cluster = query.cluster;
        let bottom_z_m = (cluster.centre_in_base.z - cluster.size_m.z / 2.0) as f32;
        let Some(shape) = shape::measure(&cluster.points_in_base, bottom_z_m) else { return Ok(()) };
        let handle_end = self.vocabulary.category(query.object_name).and_then(|category| category.handle_end);
        let Some(part) = parts::part(&shape, query.affordance, handle_end) else {
            tracing::debug!(part = query.affordance, object = query.object_name, shape = ?shape.class, "the shape shows no such part");
            return Ok(());
        };
        if matches!(part, Part::Whole) {
            tracing::debug!(part = query.affordance, shape = ?shape.class, "the shape has no parts of its own: taking all of it");
        }
        let members = Members::of(&cluster.points_in_base);
        for (view, mask) in views.iter().zip(out) {
            *mask = AffordanceMask::empty(&view.camera, view.intrinsics.width, view.intrinsics.height);
            mask.pixels = part_pixels(view, &members, |point| {
                point.z > bottom_z_m + clustering::LOW_POINT_M && part.contains(&shape, point)
            });
            if mask.n_selected() as f64 > MAX_MASK_SHARE * mask.pixels.len() as f64 {
                mask.pixels.fill(0);
            }
        }
        Ok(())
    }
}

/// The cleaned mask of the pixels of one thing that satisfy `on_part`.
fn part_pixels(view: &RgbdImage, members: &Members, on_part: impl Fn(&Point3<f32>) -> bool) -> Vec<u8> {
    let (width, height) = (view.intrinsics.width, view.intrinsics.height);
    let mut raw = vec![0_u8; width * height];
    cloud::for_each_return(view, |pixel, point| {
        if members.contains(&point) && on_part(&point) {
            raw[pixel] = 1;
        }
    });
    // Closing first: dropouts riddle the mask, and opening would tear thin handles at each hole.
    let closed = morphology::close(&raw, width, height, 2);
    let mut cleaned = morphology::open(&closed, width, height, 1);
    morphology::drop_small(&mut cleaned, width, MIN_PART_PIXELS);
    cleaned
}

/// The space near a cluster's points, as a set of small cubes.
struct Members {
    low: Point3<f32>,
    high: Point3<f32>,
    cubes: HashSet<[i32; 3]>,
}

impl Members {
    fn of(points: &[Point3<f32>]) -> Self {
        let margin = Vector3::repeat(MEMBERSHIP_M);
        let low = points.iter().fold(Point3::from(Vector3::repeat(f32::MAX)), |low, p| low.inf(p)) - margin;
        let high = points.iter().fold(Point3::from(Vector3::repeat(f32::MIN)), |high, p| high.sup(p)) + margin;
        let cubes = points.iter().map(cube).collect();
        Self { low, high, cubes }
    }

    fn contains(&self, point: &Point3<f32>) -> bool {
        let inside = |axis: usize| point[axis] >= self.low[axis] && point[axis] <= self.high[axis];
        inside(0) && inside(1) && inside(2) && self.cubes.contains(&cube(point))
    }
}

fn cube(point: &Point3<f32>) -> [i32; 3] {
    [0, 1, 2].map(|axis| (point[axis] / MEMBERSHIP_M).floor() as i32)
}

fn failed(message: &str) -> PluginError {
    PluginError::Failed { plugin: NAME.to_owned(), message: message.to_owned() }
}

#[cfg(test)]
mod tests;
