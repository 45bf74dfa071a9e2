//! What a world is built from.

use crate::WorldError;
use serde::{Deserialize, Serialize};
use sfg_geometry::{ObjectInstance, ObjectModel};
use std::path::Path;

/// Numbers of the simulation that a scenario may choose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WorldSettings {
    /// Friction coefficient between any two of hand, objects, table; at most 0.8.
    pub pair_friction: f64,
    /// Friction coefficient of a grain with anything. Low, so that grains flow like rice, not like gravel.
    pub grain_friction: f64,
    /// Radius of a grain, metres.
    pub grain_radius_m: f64,
    /// Mass of a grain, kg.
    pub grain_mass_kg: f64,
    /// Simulated time before time zero, in which objects and grains come to rest, seconds.
    pub settle_secs: f64,
    /// Whether the cameras have noise, dropouts and quantised depth.
    pub camera_noise: bool,
}

impl Default for WorldSettings {
    fn default() -> Self {
        Self {
            pair_friction: 0.6,
            grain_friction: 0.3,
            grain_radius_m: 0.004,
            grain_mass_kg: 0.00032,
            settle_secs: 0.5,
            camera_noise: true,
        }
    }
}

/// A table: a slab with its top at `height_m`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TableSpec {
    /// Height of the top above the floor, metres.
    pub height_m: f64,
    /// Near and far edge along base x, metres. The near edge stays clear of the robot's elbows.
    pub x_m: [f64; 2],
    /// Right and left edge along base y, metres.
    pub y_m: [f64; 2],
    /// Thickness of the slab, metres.
    pub thickness_m: f64,
    /// Colour of the top.
    pub colour: [u8; 3],
}

impl Default for TableSpec {
    fn default() -> Self {
        Self { height_m: 0.75, x_m: [0.38, 1.08], y_m: [-0.7, 0.7], thickness_m: 0.03, colour: [188, 170, 146] }
    }
}

/// One object on the table.
#[derive(Clone, Debug)]
pub struct ObjectSpec {
    /// Name in this scene, for example `bottle`.
    pub name: String,
    /// Shape, labels, mass range.
    pub instance: ObjectInstance,
    /// Position of its origin on the table, base frame, metres.
    pub x_m: f64,
    /// Position along base y, metres.
    pub y_m: f64,
    /// Rotation about +Z, radians.
    pub yaw_rad: f64,
    /// Mass without grains; the instance's own when absent.
    pub mass_kg: Option<f64>,
    /// Masses that its file allows; only the instance's own mass when absent.
    pub mass_range_kg: Option<[f64; 2]>,
    /// Grains that it holds at time zero.
    pub n_grains: usize,
    /// Colour of the whole object; the model's own colours when absent.
    pub colour: Option<[u8; 3]>,
}

impl ObjectSpec {
    /// An empty object with its own mass and colours.
    #[must_use]
    pub fn new(name: &str, instance: ObjectInstance, x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Self { name: name.to_owned(), instance, x_m, y_m, yaw_rad, mass_kg: None, mass_range_kg: None, n_grains: 0, colour: None }
    }

    /// One variant of a declarative model, with the masses that its file allows; `unit` as in [`ObjectModel::params_at`].
    ///
    /// # Errors
    /// [`WorldError::BadScene`] when the model contradicts itself.
    pub fn from_model(
        name: &str,
        model: &ObjectModel,
        unit: [f64; 3],
        x_m: f64,
        y_m: f64,
        yaw_rad: f64,
    ) -> Result<Self, WorldError> {
        let instance = model.instantiate(&model.params_at(unit));
        let instance = instance.map_err(|error| WorldError::BadScene { what: name.to_owned(), message: error.to_string() })?;
        let range = model.mass_range_kg.unwrap_or([model.mass_kg; 2]);
        Ok(Self { mass_range_kg: Some(range), ..Self::new(name, instance, x_m, y_m, yaw_rad) })
    }

    /// Its mass without content, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.mass_kg.unwrap_or(self.instance.mass.mass_kg)
    }

    /// Masses that the judge accepts, kg.
    #[must_use]
    pub fn allowed_mass(&self) -> [f64; 2] {
        self.mass_range_kg.unwrap_or([self.instance.mass.mass_kg; 2])
    }

    /// The same, filled.
    #[must_use]
    pub fn with_grains(mut self, n_grains: usize) -> Self {
        self.n_grains = n_grains;
        self
    }
}

/// A whole scene; the robot is given apart.
#[derive(Clone, Debug, Default)]
pub struct SceneSpec {
    /// The table.
    pub table: TableSpec,
    /// What stands on it.
    pub objects: Vec<ObjectSpec>,
    /// Numbers of the simulation.
    pub settings: WorldSettings,
    /// Seed of every random stream: grain packing, sensor noise.
    pub seed: u64,
}

impl SceneSpec {
    /// Checks everything that can be checked without physics.
    ///
    /// # Errors
    /// [`WorldError::BadScene`] naming the first impossible value.
    pub fn validate(&self) -> Result<(), WorldError> {
        let bad = |what: &str, message: String| Err(WorldError::BadScene { what: what.to_owned(), message });
        let s = &self.settings;
        for (name, value, most) in [
            ("pair_friction", s.pair_friction, f64::from(crate::judge::MAX_PAIR_FRICTION)),
            ("grain_friction", s.grain_friction, f64::from(crate::judge::MAX_PAIR_FRICTION)),
        ] {
            // Read from f32 so that the documented 0.8 itself is accepted.
            if !(value > 0.0 && value as f32 <= most as f32) {
                return bad(name, format!("is {value}, expected more than 0 and at most 0.8"));
            }
        }
        for (name, value, least, most) in [
            ("grain_radius_m", s.grain_radius_m, 0.002, 0.02),
            ("grain_mass_kg", s.grain_mass_kg, 1e-5, 0.1),
            ("settle_secs", s.settle_secs, 0.0, 10.0),
            ("table.height_m", self.table.height_m, 0.1, 2.0),
            ("table.thickness_m", self.table.thickness_m, 0.005, 0.5),
        ] {
            if !(least..=most).contains(&value) {
                return bad(name, format!("is {value}, expected {least} to {most}"));
            }
        }
        for (name, [low, high]) in [("table.x_m", self.table.x_m), ("table.y_m", self.table.y_m)] {
            if !(low.is_finite() && high.is_finite() && high - low >= 0.1) {
                return bad(name, format!("is [{low}, {high}], expected two edges at least 0.1 m apart"));
            }
        }
        for (idx, object) in self.objects.iter().enumerate() {
            if object.name.is_empty() || self.objects[..idx].iter().any(|other| other.name == object.name) {
                return bad(&object.name, "needs a name of its own".to_owned());
            }
            let on_table = (self.table.x_m[0]..=self.table.x_m[1]).contains(&object.x_m)
                && (self.table.y_m[0]..=self.table.y_m[1]).contains(&object.y_m);
            if !on_table || !object.yaw_rad.is_finite() {
                return bad(&object.name, format!("at ({}, {}) m is not on the table", object.x_m, object.y_m));
            }
            let [least, most] = object.allowed_mass();
            if !(least > 0.0 && most < 50.0 && (least - 1e-9..=most + 1e-9).contains(&object.mass())) {
                return bad(&object.name, format!("has {} kg, its file allows {least} to {most} kg", object.mass()));
            }
            if object.n_grains > 0 && object.instance.interior.is_none() {
                return bad(&object.name, "is to hold grains but is no vessel".to_owned());
            }
        }
        Ok(())
    }
}

/// Largest object file read, bytes.
const MAX_OBJECT_FILE_BYTES: usize = 1 << 20;

/// Reads a declarative object model such as `scenarios/objects/bottle.yaml`.
///
/// # Errors
/// [`WorldError::ReadFile`] when it cannot be read, [`WorldError::ObjectFile`] with line and column otherwise.
pub fn load_object_model(path: &Path) -> Result<ObjectModel, WorldError> {
    let text = std::fs::read_to_string(path).map_err(|source| WorldError::ReadFile { path: path.to_owned(), source })?;
    let broken = |message: String| WorldError::ObjectFile { path: path.to_owned(), message };
    if text.len() > MAX_OBJECT_FILE_BYTES {
        return Err(broken(format!("has {} bytes, at most {MAX_OBJECT_FILE_BYTES} are read", text.len())));
    }
    serde_saphyr::from_str(&text).map_err(|error| broken(error.to_string()))
}
