//! What a filter changed, and why.

use std::fmt;

/// Which limit a command would have broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Limit {
    /// Not one value for each joint.
    Length,
    /// A value is infinite or not a number.
    NotANumber,
    /// Range of a joint or a motor, or no room left to brake before its end.
    Position,
    /// Speed.
    Velocity,
    /// Acceleration.
    Acceleration,
    /// Change of the acceleration.
    Jerk,
    /// The box of the palm.
    Workspace,
    /// Distance from obstacles or the robot itself.
    Distance,
    /// Motor current of the hand.
    Force,
    /// The source said nothing while the arm moved.
    Silence,
    /// The arm was stopped and takes no commands.
    Stopped,
}

impl Limit {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Length => "length",
            Self::NotANumber => "not_a_number",
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
            Self::Jerk => "jerk",
            Self::Workspace => "workspace",
            Self::Distance => "distance",
            Self::Force => "force",
            Self::Silence => "silence",
            Self::Stopped => "stopped",
        }
    }
}

/// What the filter changed, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Intervention {
    /// Whose limit: a joint's name, `palm x`, `hand synergy`, or what would touch what.
    pub subject: String,
    /// Which limit.
    pub limit: Limit,
    /// The value that was asked for; NaN when it was no number.
    pub value: f64,
    /// The limit's value.
    pub bound: f64,
    /// Unit of both.
    pub unit: &'static str,
    /// Largest change of a joint's set point, radians (or strokes of the hand).
    pub by: f64,
}

impl fmt::Display for Intervention {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { subject, value, bound, unit, .. } = self;
        match self.limit {
            Limit::Length => write!(f, "{value} values for {bound} joints"),
            Limit::NotANumber => write!(f, "{subject}: {value} is no number"),
            Limit::Silence => f.write_str("no command came while the arm moved"),
            Limit::Stopped => f.write_str("the arm was stopped"),
            Limit::Distance => f.write_str(subject),
            Limit::Position => write!(f, "{subject}: position {value:.4} {unit} breaks the limit {bound:.4} {unit}"),
            Limit::Velocity => write!(f, "{subject}: velocity {value:.4} {unit} breaks the limit {bound:.4} {unit}"),
            Limit::Acceleration => write!(f, "{subject}: acceleration {value:.4} {unit} breaks the limit {bound:.4} {unit}"),
            Limit::Jerk => write!(f, "{subject}: jerk {value:.4} {unit} breaks the limit {bound:.4} {unit}"),
            Limit::Workspace => {
                write!(f, "{subject}: {value:.4} {unit} is outside the workspace, which ends at {bound:.4} {unit}")
            }
            Limit::Force => write!(f, "{subject}: current {value:.2} {unit} breaks the limit {bound:.2} {unit}"),
        }
    }
}

impl std::error::Error for Intervention {}
