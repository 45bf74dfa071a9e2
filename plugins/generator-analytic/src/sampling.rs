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
/// Heights of a level palm over the lowest at which the open hand fits over the table, metres.
const RISES_M: [f64; 8] = [0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14];
/// How far beyond the end of the body the middle of a wrap may be, metres.
const BEYOND_M: f64 = 0.02;
/// A wrap holds the thing within this of the key point, along the axis, metres.
const AROUND_KEY_M: f64 = 0.08;
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
    /// Proposals of one group are one grasp of an upright thing from places around it that look alike.
    pub group: Option<usize>,
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
    /// Which of the sides that look alike; all of a round thing do, opposite ones of the others.
    kind: usize,
    /// From the axis to the line along which the palm comes, metres.
    offset: Vector,
    is_probe: bool,
}

/// Sides of a thing with two planes of symmetry that do not look alike.
const N_KINDS: usize = 2;
/// Numbers of styles that one way of coming to one axis may use.
const STYLES_PER_FAMILY: usize = 1024;

/// What is around the hand, for the choice of its palm poses.
pub struct Place<'a> {
    /// Distances to the thing.
    pub field: &'a Field,
    /// Where to hold, base frame.
    pub key_point: Point,
    /// Height of the table, metres.
    pub table_height_m: f64,
    /// Least height of a palm of this orientation over the table at which the open hand fits there, metres.
    pub lowest_palm_m: &'a dyn Fn(&UnitQuaternion<f64>) -> f64,
}

/// All palm poses for `shape` near the key point, in an order that a mirrored scene with the other hand repeats.
#[must_use]
pub fn proposals(shape: &Shape, place: &Place<'_>, rule: &PalmRule, side: HandSide) -> Vec<Proposal> {
    let mirror = match side {
        HandSide::Left => 1.0,
        HandSide::Right => -1.0,
    };
    let mut sampler = Sampler { place, rule, mirror, first_style: 0, out: Vec::with_capacity(1024) };
    for axis in axes(shape, &place.key_point) {
        let is_upright = axis.direction.z.abs() > 0.85;
        match (is_upright, rule.opposition) {
            (true, Opposition::Palm) => sampler.wraps_around(&axis),
            (true, _) => sampler.pads_around(&axis),
            (false, Opposition::Palm) => sampler.wraps_over(&axis),
            (false, _) => sampler.pads_over(&axis),
        }
        sampler.first_style += STYLES_PER_FAMILY;
        if is_upright && (rule.from_above || rule.opposition != Opposition::Palm) {
            sampler.caps(&axis);
        }
        sampler.first_style += STYLES_PER_FAMILY;
    }
    sampler.out
}

/// Collects proposals; `first_style` moves on so that no two families of them share a style.
struct Sampler<'a> {
    place: &'a Place<'a>,
    rule: &'a PalmRule,
    /// 1 for the left hand, -1 for the right one.
    mirror: f64,
    first_style: usize,
    out: Vec<Proposal>,
}

impl Sampler<'_> {
    /// Level palms around an upright thing, thumb up and thumb down.
    ///
    /// Heights are counted from the lowest at which the open hand fits over the table, so that they depend on the hand alone. Counted from
    /// the key point, which is noisy by millimetres, a pose that just fits would come and go.
    fn wraps_around(&mut self, axis: &Axis) {
        // Nothing is under an upright thing's side, so the palm need not keep away from it.
        let standoff_m = self.rule.standoffs_m[0];
        for SideApproach { level, kind, offset, is_probe } in side_approaches(&axis.section, self.mirror) {
            let mut style = self.first_style;
            // The left thumb is at +Y, the right one at -Y.
            for up in [self.mirror, -self.mirror] {
                for skew in SKEWS_RAD {
                    let rotation = palm_rotation(&level, &(Vector::z() * up), skew * self.mirror);
                    let lowest_m = self.place.table_height_m + (self.place.lowest_palm_m)(&rotation);
                    for rise_m in RISES_M {
                        for [centre_x, centre_y] in &self.rule.centres_m {
                            let palm_z = lowest_m + rise_m;
                            let centre = rotation * Vector::new(*centre_x, *centre_y, standoff_m);
                            let along_m = (palm_z + centre.z - axis.origin.z) / axis.direction.z;
                            // At the shoulder of a short bottle the lower fingers still find its body.
                            let nearest_m = along_m.clamp(axis.range_m.0, axis.range_m.1);
                            if along_m.abs() <= AROUND_KEY_M && (along_m - nearest_m).abs() <= BEYOND_M {
                                let towards = axis.origin + axis.direction * nearest_m + offset;
                                let rise = Vector::z() * (axis.direction.z * (nearest_m - along_m));
                                self.push(&towards, &level, &rotation, &(centre + rise), style, Some(kind), is_probe);
                            }
                            style += 1;
                        }
                    }
                }
            }
        }
    }

    /// Pads beside an upright thing, level and pitched, thumb up, down and across.
    fn pads_around(&mut self, axis: &Axis) {
        for SideApproach { level, kind, offset, is_probe } in side_approaches(&axis.section, self.mirror) {
            let across = Vector::z().cross(&level);
            let mut style = self.first_style;
            for along_m in ALONG_M {
                for pitch in PAD_PITCHES_RAD {
                    let approach = level * pitch.cos() - Vector::z() * pitch.sin();
                    for y in [Vector::z() * self.mirror, -Vector::z() * self.mirror, across, -across] {
                        if axis.reaches(along_m) {
                            let towards = axis.origin + axis.direction * along_m + offset;
                            self.add(&towards, &approach, &y, style, Some(kind), is_probe);
                        }
                        style += self.n_per_style();
                    }
                }
            }
        }
    }

    /// Palms over a lying thing.
    fn wraps_over(&mut self, axis: &Axis) {
        let turns: &[f64] = if matches!(axis.section, Section::Box(_)) { &LYING_RAD[..1] } else { &LYING_RAD };
        for (along_idx, along_m) in axis.places() {
            for (turn_idx, turn) in turns.iter().enumerate() {
                for (roll_idx, roll) in [1.0, -1.0].into_iter().enumerate() {
                    let y = axis.direction * (roll * self.mirror);
                    let style = self.first_style + (2 * turn_idx + roll_idx) * self.n_per_style();
                    let towards = axis.origin + axis.direction * along_m;
                    self.add(&towards, &axis.approach_from_above(turn * self.mirror), &y, style, None, is_along_probe(along_idx));
                }
            }
        }
    }

    /// Pads over a lying thing.
    fn pads_over(&mut self, axis: &Axis) {
        for (along_idx, along_m) in axis.places() {
            for (turn_idx, turn) in [0.0, 0.52, -0.52].into_iter().enumerate() {
                let approach = axis.approach_from_above(turn * self.mirror);
                for (roll_idx, roll) in [0.0, 0.26, -0.26, PI, PI + 0.26, PI - 0.26].into_iter().enumerate() {
                    let spin = UnitQuaternion::from_axis_angle(&Unit::new_normalize(approach), roll * self.mirror);
                    let y = spin * axis.direction * self.mirror;
                    let style = self.first_style + (6 * turn_idx + roll_idx) * self.n_per_style();
                    self.add(&(axis.origin + axis.direction * along_m), &approach, &y, style, None, is_along_probe(along_idx));
                }
            }
        }
    }

    /// Hands that come from above around the top of an upright thing.
    fn caps(&mut self, axis: &Axis) {
        for place in 0..N_AZIMUTHS {
            let yaw = self.mirror * 2.0 * PI * place as f64 / N_AZIMUTHS as f64;
            let y = Vector::new(yaw.cos(), yaw.sin(), 0.0) * self.mirror;
            self.add(&axis.origin, &-Vector::z(), &y, self.first_style, None, is_around_probe(place));
            if self.rule.from_above {
                let tilted = UnitQuaternion::from_axis_angle(&Unit::new_normalize(y), -0.52) * -Vector::z();
                self.add(&axis.origin, &tilted, &y, self.first_style + self.n_per_style(), None, is_around_probe(place));
            }
        }
    }

    fn skews(&self) -> &'static [f64] {
        if self.rule.opposition == Opposition::Palm { &SKEWS_RAD } else { &SKEWS_RAD[..1] }
    }

    fn n_per_style(&self) -> usize {
        self.skews().len() * self.rule.standoffs_m.len() * self.rule.centres_m.len()
    }

    /// Every skew, stand-off and centre of one approach.
    fn add(&mut self, towards: &Point, approach: &Vector, y: &Vector, first_style: usize, kind: Option<usize>, is_probe: bool) {
        let mut style = first_style;
        for skew in self.skews() {
            let rotation = palm_rotation(approach, y, skew * self.mirror);
            for standoff_m in &self.rule.standoffs_m {
                for [centre_x, centre_y] in &self.rule.centres_m {
                    let surface = rotation * Vector::new(*centre_x, *centre_y, *standoff_m);
                    self.push(towards, approach, &rotation, &surface, style, kind, is_probe);
                    style += 1;
                }
            }
        }
    }

    /// `surface` is where the surface lies seen from the palm, in the base frame's directions.
    #[expect(clippy::too_many_arguments, reason = "what a proposal is made of")]
    fn push(
        &mut self,
        towards: &Point,
        approach: &Vector,
        rotation: &UnitQuaternion<f64>,
        surface: &Vector,
        style: usize,
        kind: Option<usize>,
        is_probe: bool,
    ) {
        let Some(facing) = surface_along(self.place.field, towards, approach) else { return };
        self.out.push(Proposal {
            base_from_palm: Pose::from_parts((facing - surface).coords.into(), *rotation),
            facing,
            style,
            group: kind.map(|kind| N_KINDS * style + kind),
            is_probe,
        });
    }
}

impl Axis {
    fn reaches(&self, along_m: f64) -> bool {
        (self.range_m.0..=self.range_m.1).contains(&along_m)
    }

    /// Places along the axis with their numbers.
    fn places(&self) -> impl Iterator<Item = (usize, f64)> {
        ALONG_M.into_iter().enumerate().filter(|(_, along_m)| self.reaches(*along_m))
    }

    /// Direction from straight above a lying axis, turned about it.
    fn approach_from_above(&self, turn_rad: f64) -> Vector {
        let down = -(Vector::z() - self.direction * self.direction.z).try_normalize(1e-6).unwrap_or_else(Vector::z);
        UnitQuaternion::from_axis_angle(&Unit::new_normalize(self.direction), turn_rad) * down
    }
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
        let kind = if matches!(section, Section::Round) { 0 } else { place % N_KINDS };
        SideApproach { level, kind, offset, is_probe }
    };
    (0..n).map(approach).collect()
}

/// Two places along a lying thing.
fn is_along_probe(along_idx: usize) -> bool {
    along_idx == 0 || along_idx == 3
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

/// Palm axes: z along the approach, y as given but square to it, then turned about z by `skew_rad`.
fn palm_rotation(approach: &Vector, y: &Vector, skew_rad: f64) -> UnitQuaternion<f64> {
    let z = *approach;
    let y = (y - z * y.dot(&z)).normalize();
    let y = y * skew_rad.cos() - z.cross(&y) * skew_rad.sin();
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z])))
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
