//! What the user asked for.

use serde::{Deserialize, Serialize};

/// A typed sentence, trimmed and known not to be empty.
///
/// # Source
/// The language input `L` of SayFuncGrasp, section III.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Instruction(String);

/// Longest accepted instruction. A longer text is a mistake or an attack, never a sentence to a robot.
pub const MAX_INSTRUCTION_BYTES: usize = 4096;

/// Why a text is no instruction.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InstructionError {
    /// Nothing but white space.
    #[error("the instruction is empty; say what to do, for example \"pour the water into the bowl\"")]
    Empty,
    /// Longer than [`MAX_INSTRUCTION_BYTES`].
    #[error("the instruction has {n_bytes} bytes, at most {MAX_INSTRUCTION_BYTES} are accepted")]
    TooLong {
        /// Length of the refused text.
        n_bytes: usize,
    },
}

impl Instruction {
    /// The instruction in `text`, trimmed.
    ///
    /// # Errors
    /// [`InstructionError`] when nothing is left or the text is too long.
    pub fn new(text: &str) -> Result<Self, InstructionError> {
        let text = text.trim();
        if text.is_empty() {
            return Err(InstructionError::Empty);
        }
        if text.len() > MAX_INSTRUCTION_BYTES {
            return Err(InstructionError::TooLong { n_bytes: text.len() });
        }
        Ok(Self(text.to_owned()))
    }

    /// The sentence.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for Instruction {
    type Error = InstructionError;
    fn try_from(text: String) -> Result<Self, Self::Error> {
        Self::new(&text)
    }
}

impl From<Instruction> for String {
    fn from(instruction: Instruction) -> Self {
        instruction.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blank_and_oversized_texts_are_refused() {
        assert_eq!(Instruction::new(" \n"), Err(InstructionError::Empty));
        let long = "x".repeat(MAX_INSTRUCTION_BYTES + 1);
        assert_eq!(Instruction::new(&long), Err(InstructionError::TooLong { n_bytes: long.len() }));
        assert_eq!(Instruction::new("  pour ").map(String::from), Ok("pour".to_owned()));
    }
}
