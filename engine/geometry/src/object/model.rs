//! The declarative object format: what a file under `scenarios/objects` says.

use super::instance::{Interior, ObjectInstance, Part, PlacedPrimitive, Surface};
use super::piece::pieces_of;
use super::primitive::Primitive;
use super::profile::Profile;
use crate::GeometryError;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use sfg_types::Pose;

/// A category of objects: labelled parts and the ranges in which they vary.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectModel {
    /// Name of the category, lower case: `mug`.
    pub category: String,
    /// Other words for it.
    #[serde(default)]
    pub words: Vec<String>,
    /// Nominal mass.
    pub mass_kg: f64,
    /// Smallest and largest mass; the nominal one when absent.
    #[serde(default)]
    pub mass_range_kg: Option<[f64; 2]>,
    /// How the shape varies.
    #[serde(default)]
    pub scale: ScaleRanges,
    /// Label of the hollow lathe that holds the content of a vessel.
    #[serde(default)]
    pub container: Option<String>,
    /// The parts; the object is their union.
    pub parts: Vec<PartModel>,
}

/// Factors on the object's size. Walls, roundings and the thickness of sweeps and tori do not vary.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScaleRanges {
    /// Smallest and largest factor along z; when absent it is always that of the radius, so that things lying down stay in shape.
    pub height: Option<[f64; 2]>,
    /// Smallest and largest factor along x and y.
    pub radius: [f64; 2],
}

impl Default for ScaleRanges {
    fn default() -> Self {
        Self { height: None, radius: [1.0; 2] }
    }
}

/// One labelled part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartModel {
    /// What people call it: `handle`, `body`, `rim`. Several parts may share a label.
    pub label: String,
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// Position of the shape in the object.
    #[serde(default)]
    pub xyz_m: [f64; 3],
    /// Roll, pitch, yaw of the shape in the object, about the fixed x, y, z axes in this order.
    #[serde(default)]
    pub rpy_deg: [f64; 3],
    /// Density against the other parts: the steel head of a hammer is about 10 times as dense as its handle.
    #[serde(default = "one")]
    pub relative_density: f64,
    /// Its geometry.
    pub shape: Shape,
}

fn one() -> f64 {
    1.0
}

/// A solid with an exact signed distance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Shape {
    /// All points within a radius of a segment along z; a ball when the length is 0.
    Capsule {
        /// Radius.
        radius_m: f64,
        /// Distance between the centres of the end balls.
        length_m: f64,
    },
    /// A box, centred.
    Box {
        /// Full lengths of the sides.
        size_m: [f64; 3],
        /// Radius of edges and corners, within the size.
        #[serde(default)]
        rounding_m: f64,
    },
    /// A profile turned about z.
    Lathe {
        /// `[radius, height]` of the outside, bottom to top. A first radius above 0 implies a flat base.
        profile_m: Vec<[f64; 2]>,
        /// Makes it a vessel open at the top with walls and floor of this thickness inside the profile; solid when absent.
        #[serde(default)]
        wall_m: Option<f64>,
    },
    /// A ring in the xy plane, or an arc of it centred on +x with round ends.
    Torus {
        /// From the centre to the middle of the tube.
        major_radius_m: f64,
        /// Of the tube.
        minor_radius_m: f64,
        /// 360 for the full ring.
        #[serde(default = "full_turn")]
        arc_deg: f64,
    },
    /// A round bar along a polyline.
    Sweep {
        /// Corners of the polyline.
        points_m: Vec<[f64; 3]>,
        /// Of the bar.
        radius_m: f64,
    },
}

fn full_turn() -> f64 {
    360.0
}

/// One choice within the ranges of a model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectParams {
    /// Factor along z.
    pub height: f64,
    /// Factor along x and y.
    pub radius: f64,
    /// Mass.
    pub mass_kg: f64,
}

impl ObjectModel {
    /// The object as drawn, with its nominal mass.
    #[must_use]
    pub fn nominal_params(&self) -> ObjectParams {
        ObjectParams { height: 1.0, radius: 1.0, mass_kg: self.mass_kg }
    }

    /// The variant at a point of the unit cube: height, radius and mass each from the low end (0) to the high end (1) of its range.
    #[must_use]
    pub fn params_at(&self, unit: [f64; 3]) -> ObjectParams {
        let lerp = |[low, high]: [f64; 2], t: f64| low + (high - low) * t.clamp(0.0, 1.0);
        let radius = lerp(self.scale.radius, unit[1]);
        ObjectParams {
            height: self.scale.height.map_or(radius, |range| lerp(range, unit[0])),
            radius,
            mass_kg: lerp(self.mass_range_kg.unwrap_or([self.mass_kg; 2]), unit[2]),
        }
    }

    /// The solid object for one choice of parameters.
    ///
    /// # Errors
    /// [`GeometryError::BadModel`] for a size that is not positive, a profile that crosses its axis or falls, an unknown container
    /// part, or parameters outside the ranges.
    pub fn instantiate(&self, params: &ObjectParams) -> Result<ObjectInstance, GeometryError> {
        let bad = |part: &str, message: String| GeometryError::BadModel {
            category: self.category.clone(),
            part: part.to_owned(),
            message,
        };
        self.check(params).map_err(|message| bad("*", message))?;
        let mut placed = Vec::with_capacity(self.parts.len());
        let mut pieces = Vec::new();
        for (part_idx, part) in self.parts.iter().enumerate() {
            let (object_from_part, primitive) = part.scaled(params).map_err(|message| bad(&part.label, message))?;
            pieces.extend(pieces_of(&primitive, &object_from_part, part_idx).map_err(|message| bad(&part.label, message))?);
            placed.push(PlacedPrimitive {
                part_from_object: object_from_part.inverse(),
                primitive,
                relative_density: part.relative_density,
            });
        }
        let interior = match &self.container {
            None => None,
            Some(label) => Some(self.interior_of(label, &placed).map_err(|message| bad(label, message))?),
        };
        let parts = self.parts.iter().map(|p| Part { label: p.label.clone(), colour: p.colour }).collect();
        Ok(ObjectInstance::new(
            self.category.clone(),
            self.words.clone(),
            parts,
            pieces,
            interior,
            Surface::Parts(placed),
            params.mass_kg,
        ))
    }

    fn check(&self, params: &ObjectParams) -> Result<(), String> {
        if self.parts.is_empty() {
            return Err("an object needs at least one part".to_owned());
        }
        let mass_range = self.mass_range_kg.unwrap_or([self.mass_kg; 2]);
        for (name, value, [low, high]) in [
            ("height", params.height, self.scale.height.unwrap_or([params.radius; 2])),
            ("radius", params.radius, self.scale.radius),
            ("mass_kg", params.mass_kg, mass_range),
        ] {
            if !(low > 0.0 && high >= low && high.is_finite()) {
                return Err(format!("the range [{low}, {high}] of {name} is not positive and rising"));
            }
            if !(low - 1e-9..=high + 1e-9).contains(&value) {
                return Err(format!("{name} {value} is outside its range [{low}, {high}]"));
            }
        }
        Ok(())
    }

    fn interior_of(&self, label: &str, placed: &[PlacedPrimitive]) -> Result<Interior, String> {
        for (part, placed) in self.parts.iter().zip(placed) {
            let Primitive::Lathe(profile) = &placed.primitive else { continue };
            let Some(inner) = profile.inner().filter(|_| part.label == label) else { continue };
            if part.rpy_deg != [0.0; 3] {
                return Err("a container must stand upright: rpy_deg must be 0".to_owned());
            }
            let origin = placed.part_from_object.inverse().translation.vector;
            return Ok(Interior::new([origin.x, origin.y], inner.iter().map(|[r, z]| [z + origin.z, *r]).collect()));
        }
        Err("the container names no lathe with wall_m".to_owned())
    }
}

impl PartModel {
    /// Pose and geometry at the given scale. Lengths along a local axis take the factor of that axis in the object frame, so
    /// that a scaled part still touches its neighbours.
    fn scaled(&self, params: &ObjectParams) -> Result<(Pose, Primitive), String> {
        if !(self.relative_density > 0.0 && self.relative_density.is_finite()) {
            return Err(format!("relative_density {} is not positive", self.relative_density));
        }
        let factors = Vector3::new(params.radius, params.radius, params.height);
        let [roll, pitch, yaw] = self.rpy_deg.map(f64::to_radians);
        let position = Vector3::from(self.xyz_m).component_mul(&factors);
        let object_from_part =
            Pose::new(position, Vector3::zeros()) * nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let along = |axis: Vector3<f64>| (object_from_part.rotation * axis).component_mul(&factors).norm();
        let (sx, sy, sz) = (along(Vector3::x()), along(Vector3::y()), along(Vector3::z()));
        let around = (sx * sy).sqrt();
        let positive = |name: &str, value: f64| {
            if value > 0.0 && value.is_finite() { Ok(value) } else { Err(format!("{name} {value} is not positive")) }
        };
        let primitive = match &self.shape {
            Shape::Capsule { radius_m, length_m } => {
                if !(0.0..f64::INFINITY).contains(length_m) {
                    return Err(format!("length_m {length_m} is not a finite number of at least 0"));
                }
                Primitive::Capsule { half_height: length_m * sz / 2.0, radius: positive("radius_m", *radius_m)? * around }
            }
            Shape::Box { size_m, rounding_m } => {
                let half = Vector3::new(size_m[0] * sx, size_m[1] * sy, size_m[2] * sz) / 2.0;
                positive("the smallest side of size_m", half.min())?;
                if !(0.0..=half.min()).contains(rounding_m) {
                    return Err(format!("rounding_m {rounding_m} is not within 0 and half the smallest side, {}", half.min()));
                }
                Primitive::Box { half, rounding: *rounding_m }
            }
            Shape::Lathe { profile_m, wall_m } => {
                let scaled: Vec<[f64; 2]> = profile_m.iter().map(|[r, z]| [r * around, z * sz]).collect();
                Primitive::Lathe(match wall_m {
                    Some(wall_m) => Profile::vessel(&scaled, positive("wall_m", *wall_m)?)?,
                    None => Profile::solid(&scaled)?,
                })
            }
            Shape::Torus { major_radius_m, minor_radius_m, arc_deg } => {
                if !(*arc_deg > 0.0 && *arc_deg <= 360.0) {
                    return Err(format!("arc_deg {arc_deg} is not within 0 and 360"));
                }
                Primitive::Torus {
                    major: positive("major_radius_m", *major_radius_m)? * around,
                    minor: positive("minor_radius_m", *minor_radius_m)?,
                    half_arc: arc_deg.to_radians() / 2.0,
                }
            }
            Shape::Sweep { points_m, radius_m } => {
                if points_m.len() < 2 {
                    return Err(format!("a sweep needs 2 points, it has {}", points_m.len()));
                }
                // Each corner is scaled in the object frame and brought back, so that ends stay attached.
                let part_from_object = object_from_part.inverse();
                let unscaled = Pose::new(Vector3::from(self.xyz_m), Vector3::zeros()) * object_from_part.rotation;
                let points = points_m
                    .iter()
                    .map(|p| part_from_object * Point3::from((unscaled * Point3::from(*p)).coords.component_mul(&factors)))
                    .collect();
                Primitive::Sweep { points, radius: positive("radius_m", *radius_m)? }
            }
        };
        Ok((object_from_part, primitive))
    }
}
