//! Palm poses around a fitted shape, before any is closed: which axis, from which side, how high, how rolled, how near.

use crate::field::Field;
use crate::shape::Shape;
use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion};
use sfg_geometry::Oval;
use sfg_types::{HandSide, Opposition, Point, Pose, Vector};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Steps of a full turn: 15 degrees.
const N_AZIMUTHS: usize = 24;
/// The same around an oval thing, which is approached square to its surface.
const N_OVAL_AZIMUTHS: usize = 4;
/// Downward tilts of a side approach with the finger tips, radians. A palm comes level: tilted, it meets a standing thing at one edge.
const PAD_PITCHES_RAD: [f64; 2] = [0.0, FRAC_PI_4];
/// Positions along the axis, from the one nearest to the key point, metres.
const ALONG_M: [f64; 6] = [0.0, 0.02, -0.02, 0.04, -0.04, 0.06];
/// Turns of the palm about its normal in a power grasp, radians: a thing that leans towards the finger tips lies between thumb and fingers.
const SKEWS_RAD: [f64; 4] = [0.0, -0.15, -0.3, -0.45];
/// Approach directions about a lying axis, from straight down, radians.
const LYING_RAD: [f64; 11] = [0.0, 0.13, -0.13, 0.26, -0.26, 0.52, -0.52, 0.79, -0.79, 1.05, -1.05];
/// Where a ray towards the axis starts, metres.
const RAY_START_M: f64 = 0.22;

/// What a grasp type asks of the palm's place.
#[derive(Clone, Debug, PartialEq)]
pub struct PalmRule {
    /// Which surfaces oppose each other.
    pub opposition: Opposition,
    /// The fingers may come from above around a ball or a cap.
    pub from_above: bool,
    /// Distances of the palm's surface from the object, metres.
    pub standoffs_m: Vec<f64>,
    /// Where the held thing lies in the palm's plane, palm frame x and y, metres. Several are tried.
    pub centres_m: Vec<[f64; 2]>,
}

/// A palm pose to be tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proposal {
    /// Where.
    pub base_from_palm: Pose,
    /// Point of the surface that the palm faces, base frame.
    pub facing: Point,
    /// Number of its way of grasping: tilt, roll, skew, offset, stand-off.
    pub style: usize,
    /// Its place is one of the few at which every style is tried: three around a round thing, the four faces of an oval one, two along
    /// a lying one, two faces of a box. What holds a thing at one place holds it at the others.
    pub is_probe: bool,
}

/// A line through the part with the directions from which a palm may come.
struct Axis {
    origin: Point,
    direction: Vector,
    /// How far the part reaches from `origin` along `direction`, metres.
    range_m: (f64, f64),
    /// What lies around it.
    section: Section,
}

/// A cross-section of the part.
enum Section {
    /// Any azimuth is as good as any other.
    Round,
    /// Form and mean radius, metres.
    Oval(Oval, f64),
    /// Azimuth of one face; a box is approached square to its faces only.
    Box(f64),
}

/// A level direction of approach.
struct SideApproach {
    level: Vector,
    /// From the axis to the line along which the palm comes, metres.
    offset: Vector,
    is_probe: bool,
}

/// All palm poses for `shape` near `key_point`, in an order that a mirrored scene with the other hand repeats.
#[must_use]
pub fn proposals(shape: &Shape, field: &Field, key_point: &Point, rule: &PalmRule, side: HandSide) -> Vec<Proposal> {
    let mirror = match side {
        HandSide::Left => 1.0,
        HandSide::Right => -1.0,
    };
    let mut out = Vec::with_capacity(1024);
    let mut add = |towards: Point, approach: Vector, y: Vector, is_probe: bool, style: usize, standoffs_m: &[f64]| {
        let Some(facing) = surface_along(field, &towards, &approach) else { return };
        let z = approach;
        let level_y = (y - z * y.dot(&z)).normalize();
        let skews: &[f64] = if rule.opposition == Opposition::Palm { &SKEWS_RAD } else { &SKEWS_RAD[..1] };
        let mut style = style * skews.len() * rule.standoffs_m.len() * rule.centres_m.len();
        for skew in skews {
            let y = level_y * skew.cos() - z.cross(&level_y) * (skew.sin() * mirror);
            let x = y.cross(&z);
            let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z]));
            let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
            for standoff_m in standoffs_m {
                for [centre_x, centre_y] in &rule.centres_m {
                    let origin = facing - z * *standoff_m - x * *centre_x - y * *centre_y;
                    out.push(Proposal {
                        base_from_palm: Pose::from_parts(origin.coords.into(), rotation),
                        facing,
                        style,
                        is_probe,
                    });
                    style += 1;
                }
            }
        }
    };
    // A family of ways to come is numbered so that no two families share a style.
    let mut first_style = 0;
    for axis in axes(shape, key_point) {
        let upright = axis.direction.z.abs() > 0.85;
        let down = -(Vector::z() - axis.direction * axis.direction.z).try_normalize(1e-6).unwrap_or_else(Vector::z);
        let about_axis = |turn: f64| UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis.direction), turn * mirror) * down;
        for (along_idx, along_m) in ALONG_M.into_iter().enumerate() {
            if along_m < axis.range_m.0 || along_m > axis.range_m.1 {
                continue;
            }
            let towards = axis.origin + axis.direction * along_m;
            let is_along_probe = along_idx == 0 || along_idx == 3;
            if upright {
                // Nothing is under an upright thing's side, so a power grasp need not keep away from it.
                let standoffs_m = if rule.opposition == Opposition::Palm { &rule.standoffs_m[..1] } else { &rule.standoffs_m };
                let is_power = rule.opposition == Opposition::Palm;
                let pitches_rad = if is_power { &PAD_PITCHES_RAD[..1] } else { &PAD_PITCHES_RAD };
                for SideApproach { level, offset, is_probe } in side_approaches(&axis.section, mirror) {
                    // The thumb up first (the left thumb is at +Y, the right one at -Y); pads may also close across.
                    let across = Vector::z().cross(&level);
                    let rolls = [Vector::z() * mirror, -Vector::z() * mirror, across, -across];
                    for (pitch_idx, pitch) in pitches_rad.iter().enumerate() {
                        let approach = level * pitch.cos() - Vector::z() * pitch.sin();
                        for (roll_idx, roll) in rolls.iter().take(if is_power { 2 } else { 4 }).enumerate() {
                            let style = first_style + (along_idx * pitches_rad.len() + pitch_idx) * rolls.len() + roll_idx;
                            add(towards + offset, approach, *roll, is_probe, style, standoffs_m);
                        }
                    }
                }
            } else if rule.opposition == Opposition::Palm {
                let turns: &[f64] = if matches!(axis.section, Section::Box(_)) { &LYING_RAD[..1] } else { &LYING_RAD };
                for (turn_idx, turn) in turns.iter().enumerate() {
                    for (roll_idx, roll) in [1.0, -1.0].into_iter().enumerate() {
                        let y = axis.direction * (roll * mirror);
                        add(
                            towards,
                            about_axis(*turn),
                            y,
                            is_along_probe,
                            first_style + 2 * turn_idx + roll_idx,
                            &rule.standoffs_m,
                        );
                    }
                }
            } else {
                for (turn_idx, turn) in [0.0, 0.52, -0.52].into_iter().enumerate() {
                    let approach = about_axis(turn);
                    for (roll_idx, roll) in [0.0, 0.26, -0.26, PI, PI + 0.26, PI - 0.26].into_iter().enumerate() {
                        let spin = UnitQuaternion::from_axis_angle(&Unit::new_normalize(approach), roll * mirror);
                        let y = spin * axis.direction * mirror;
                        add(towards, approach, y, is_along_probe, first_style + 6 * turn_idx + roll_idx, &rule.standoffs_m);
                    }
                }
            }
        }
        first_style += 64;
        if upright && (rule.from_above || rule.opposition != Opposition::Palm) {
            for place in 0..N_AZIMUTHS {
                let yaw = mirror * 2.0 * PI * place as f64 / N_AZIMUTHS as f64;
                let y = Vector::new(yaw.cos(), yaw.sin(), 0.0) * mirror;
                add(axis.origin, -Vector::z(), y, is_around_probe(place), first_style, &rule.standoffs_m);
                if rule.from_above {
                    let tilted = UnitQuaternion::from_axis_angle(&Unit::new_normalize(y), -0.52) * -Vector::z();
                    add(axis.origin, tilted, y, is_around_probe(place), first_style + 1, &rule.standoffs_m);
                }
            }
        }
        first_style += 2;
    }
    out
}

/// Level directions towards an upright axis.
fn side_approaches(section: &Section, mirror: f64) -> Vec<SideApproach> {
    let (n, first_rad) = match section {
        Section::Round => (N_AZIMUTHS, 0.0),
        Section::Oval(oval, _) => (N_OVAL_AZIMUTHS, nearest_ahead(oval.yaw_rad(), PI)),
        Section::Box(face_azimuth_rad) => (4, *face_azimuth_rad),
    };
    let approach = |place: usize| {
        let azimuth = first_rad + mirror * 2.0 * PI * place as f64 / n as f64;
        let level = Vector::new(azimuth.cos(), azimuth.sin(), 0.0);
        // The flank that faces the palm, not the axis, is what the palm comes to.
        let (offset, is_probe) = match section {
            Section::Round => (Vector::zeros(), is_around_probe(place)),
            Section::Oval(oval, radius_m) => {
                let flank = oval.support(&-level.xy()) * *radius_m;
                (Vector::new(flank.x, flank.y, 0.0), place.is_multiple_of(N_OVAL_AZIMUTHS / 4))
            }
            Section::Box(_) => (Vector::zeros(), place == 0 || place == 3),
        };
        SideApproach { level, offset, is_probe }
    };
    (0..n).map(approach).collect()
}

/// Three places around a full turn.
fn is_around_probe(place: usize) -> bool {
    place.is_multiple_of(N_AZIMUTHS / 2) || place == 3
}

/// Of the azimuths that differ from `yaw_rad` by multiples of `step_rad` the one nearest to straight ahead.
fn nearest_ahead(yaw_rad: f64, step_rad: f64) -> f64 {
    yaw_rad - (yaw_rad / step_rad).round() * step_rad
}

fn axes(shape: &Shape, key_point: &Point) -> Vec<Axis> {
    match shape {
        Shape::Revolution { origin, axis, oval, from_m, to_m, .. } => {
            let along = (key_point - origin).dot(axis).clamp(*from_m, *to_m);
            let direction = axis.into_inner();
            vec![Axis {
                origin: origin + direction * along,
                direction,
                range_m: (from_m - along, to_m - along),
                section: if oval.aspect > 1.0 { Section::Oval(*oval, shape.mean_radius_m(key_point)) } else { Section::Round },
            }]
        }
        Shape::Cuboid { base_from_box, half_m } => {
            let centre = base_from_box * Point::origin();
            let x = base_from_box.rotation * Vector::x();
            let yaw = x.y.atan2(x.x);
            let face_azimuth = nearest_ahead(yaw, FRAC_PI_2);
            (0..3)
                .map(|i| {
                    let direction = base_from_box.rotation * Vector::ith(i, 1.0);
                    let along = (key_point - centre).dot(&direction).clamp(-half_m[i], half_m[i]);
                    Axis {
                        origin: centre + direction * along,
                        direction,
                        range_m: (-half_m[i] - along, half_m[i] - along),
                        section: Section::Box(face_azimuth),
                    }
                })
                .collect()
        }
    }
}

/// First point of the surface on the way to `towards`, by sphere tracing; `None` when the ray passes everything by.
fn surface_along(field: &Field, towards: &Point, approach: &Vector) -> Option<Point> {
    let mut gone_m = 0.0;
    while gone_m < RAY_START_M + 0.05 {
        let at = towards + approach * (gone_m - RAY_START_M);
        let distance = field.distance(&at);
        if distance < 0.0005 {
            return Some(at + approach * distance);
        }
        gone_m += distance.max(0.0005);
    }
    None
}
