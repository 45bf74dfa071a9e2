//! Text as it may stand in the page.

/// Text with the letters of markup written out; safe between tags and in quoted attributes.
pub(super) fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            letter => safe.push(letter),
        }
    }
    safe
}

/// A duration with as many digits as mean something.
pub(super) fn secs(secs: f64) -> String {
    if !secs.is_finite() {
        "unknown".to_owned()
    } else if secs < 0.0995 {
        format!("{:.0} ms", 1000.0 * secs)
    } else if secs < 9.995 {
        format!("{secs:.2} s")
    } else {
        format!("{secs:.1} s")
    }
}

/// A name of a file as words: `palm_poses` becomes `palm poses`.
pub(super) fn words(name: &str) -> String {
    escape(&name.replace('_', " "))
}

/// A share of one as per cent with one digit, inside 0 to 100.
pub(super) fn percent(share: f64) -> String {
    let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    format!("{:.1}%", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_is_written_out() {
        assert_eq!(escape("<a href=\"x\" id='y'>&</a>"), "&lt;a href=&quot;x&quot; id=&#39;y&#39;&gt;&amp;&lt;/a&gt;");
    }

    #[test]
    fn durations_have_the_digits_that_matter() {
        assert_eq!(
            [0.0, 0.0123, 0.1, 1.234, 12.34, f64::NAN].map(secs),
            ["0 ms", "12 ms", "0.10 s", "1.23 s", "12.3 s", "unknown"]
        );
    }

    #[test]
    fn shares_stay_inside() {
        assert_eq!([-1.0, 0.5, 7.0, f64::NAN].map(percent), ["0.0%", "50.0%", "100.0%", "0.0%"]);
    }
}
