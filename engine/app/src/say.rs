//! Words for the user. That nobody reads them any more (`sfg run … | head`) is no reason to drop the robot in mid-motion.

/// Writes a line to standard output, if that still takes any.
macro_rules! say {
    ($($words:tt)*) => {{
        use std::io::Write as _;
        let _nobody_listens = writeln!(std::io::stdout(), $($words)*);
    }};
}
pub(crate) use say;

/// An error with its causes; a cause that the message holds already is not said twice.
pub(crate) fn chain(error: &anyhow::Error) -> String {
    let mut words = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !words.contains(&cause) {
            words = format!("{words}: {cause}");
        }
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    #[test]
    fn a_cause_is_said_once() {
        let error = anyhow::Result::<()>::Err(anyhow::anyhow!("disk full")).context("cannot write a: disk full; free some");
        assert_eq!(error.map_err(|error| chain(&error)), Err("cannot write a: disk full; free some".to_owned()));
        let error = anyhow::Result::<()>::Err(anyhow::anyhow!("disk full")).context("cannot write a");
        assert_eq!(error.map_err(|error| chain(&error)), Err("cannot write a: disk full".to_owned()));
    }
}
