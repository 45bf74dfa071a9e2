//! How an object must be held for a task.

use crate::GraspType;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What is done with the object once it is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Task {
    /// Take and lift, nothing more.
    PickUp,
    /// Empty the object into a target.
    Pour,
    /// Give it to a person.
    HandOver,
    /// Stir the content of a pan.
    StirFry,
    /// Hang it on a hook.
    Hang,
    /// Whisk the content of a bowl.
    Whisk,
    /// Cover a vessel with it.
    Cover,
    /// Use it as the tool it is: hammer, cut, write, spray.
    Use,
}

impl Task {
    /// The name in files: `hand_over`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::PickUp => "pick_up",
            Self::Pour => "pour",
            Self::HandOver => "hand_over",
            Self::StirFry => "stir_fry",
            Self::Hang => "hang",
            Self::Whisk => "whisk",
            Self::Cover => "cover",
            Self::Use => "use",
        }
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A thing of the scene inventory, by its number and by the word used for it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectRef {
    /// [`crate::ObjectCluster::id`].
    pub cluster_id: u32,
    /// Object category, for example `bottle`.
    pub name: String,
}

/// `g_f = (affordance, grasp type)` for an object and a task, with the reasons that led there.
///
/// # Source
/// SayFuncGrasp, sections III and IV-B.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GraspFunctionality {
    /// What to hold.
    pub object: ObjectRef,
    /// What to do with it.
    pub task: Task,
    /// What the task acts on, for example the bowl that is poured into.
    pub target: Option<ObjectRef>,
    /// `g_f^a`: the part to hold, for example `body`.
    pub affordance: String,
    /// `g_f^t`: the shape of the hand.
    pub grasp_type: GraspType,
    /// 0 to 1.
    pub confidence: f64,
    /// One sentence a step, in the order of the reasoning.
    pub rationale: Vec<String>,
}

/// What a language backend answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FunctionalityAnswer {
    /// Do this.
    Act(GraspFunctionality),
    /// The sentence leaves a choice open.
    Ask {
        /// One question to the user.
        question: String,
        /// Possible answers, at least two.
        choices: Vec<String>,
    },
    /// It cannot or must not be done.
    Refuse {
        /// Why, and what the user could say instead.
        reason: String,
    },
}
