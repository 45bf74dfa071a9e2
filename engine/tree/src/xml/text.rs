//! The text of a file before it is parsed: what the parser cannot take, and what BehaviorTree.CPP's parser lets pass.

use super::problem::XmlFault;

/// The parser compares each attribute of an element with all others, and copies namespaces to each element.
const N_ATTRIBUTES_MAX: usize = 4096;
const N_NAMESPACES_MAX: usize = 64;

/// Where `text` has more attributes or namespaces than the parser takes in reasonable time.
pub(super) fn excess(text: &str) -> Option<(usize, XmlFault)> {
    if let Some((offset, _)) = text.match_indices("xmlns").nth(N_NAMESPACES_MAX) {
        return Some((offset, XmlFault::TooMany { what: "namespaces", limit: N_NAMESPACES_MAX }));
    }
    let mut start = 0;
    for element in text.split('<') {
        // An attribute has five bytes at least, so that nearly every element is known to be small without looking.
        if element.len() / 5 > N_ATTRIBUTES_MAX {
            let bytes = element.as_bytes();
            // Not the lines that some draw with it in comments.
            let is_sign = |at: &usize| bytes[*at] == b'=' && (*at == 0 || bytes[at - 1] != b'=');
            if let Some(at) = (0..bytes.len()).filter(is_sign).nth(N_ATTRIBUTES_MAX) {
                return Some((start + at, XmlFault::TooMany { what: "attributes of an element", limit: N_ATTRIBUTES_MAX }));
            }
        }
        start += element.len() + 1;
    }
    None
}

/// A text with every bare `&`, and every `<` in an attribute, written as XML wants it.
pub(super) struct Repaired {
    pub(super) text: String,
    /// From this byte on, so many bytes were added.
    pub(super) shifts: Vec<(usize, usize)>,
    /// Byte, letter, how to write it.
    pub(super) letters: Vec<(usize, &'static str, &'static str)>,
}

pub(super) fn repaired(text: &str) -> Repaired {
    let bytes = text.as_bytes();
    let mut repaired = Repaired { text: String::with_capacity(text.len() + 64), shifts: Vec::new(), letters: Vec::new() };
    let (mut copied, mut at, mut is_tag, mut quote) = (0, 0, false, None);
    while at < bytes.len() {
        let rest = &text[at..];
        let end_of = |end: &str| rest.find(end).map_or(rest.len(), |found| found + end.len());
        let mut replace = |letter, expected: &'static str| {
            repaired.text.push_str(&text[copied..at]);
            repaired.letters.push((repaired.text.len(), letter, expected));
            let added = repaired.shifts.last().map_or(0, |last| last.1) + expected.len() - 1;
            repaired.shifts.push((repaired.text.len(), added));
            repaired.text.push_str(expected);
            copied = at + 1;
        };
        let step = match (bytes[at], quote) {
            (b'<', None) if rest.starts_with("<!--") => end_of("-->"),
            (b'<', None) if rest.starts_with("<![CDATA[") => end_of("]]>"),
            (b'<', None) if rest.starts_with("<?") => end_of("?>"),
            (b'&', _) if !is_reference(rest) => {
                replace("&", "&amp;");
                1
            }
            (b'<', Some(_)) => {
                replace("<", "&lt;");
                1
            }
            (b'<' | b'>', None) => {
                is_tag = bytes[at] == b'<';
                1
            }
            (letter, Some(open)) if letter == open => {
                quote = None;
                1
            }
            (letter @ (b'"' | b'\''), None) if is_tag => {
                quote = Some(letter);
                1
            }
            _ => rest.chars().next().map_or(1, char::len_utf8),
        };
        at += step;
    }
    repaired.text.push_str(&text[copied..]);
    repaired
}

/// Whether `text` begins with a reference that every XML parser knows.
fn is_reference(text: &str) -> bool {
    let Some(name) = text[1..].bytes().take(12).position(|byte| byte == b';').map(|end| &text[1..=end]) else { return false };
    match name.strip_prefix('#') {
        Some(number) => number.bytes().all(|byte| byte.is_ascii_hexdigit() || byte == b'x'),
        None => matches!(name, "amp" | "lt" | "gt" | "quot" | "apos"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn repairs(text: &str, expected: &str) {
        assert_eq!(repaired(text).text, expected);
    }

    #[test]
    fn bare_letters_are_written_as_xml_wants() {
        repairs("<a b='x && y'/>", "<a b='x &amp;&amp; y'/>");
        repairs("<a b=\"x < 'y'\" c='>'>&t;</a>", "<a b=\"x &lt; 'y'\" c='>'>&amp;t;</a>");
        repairs("<a b='&lt;&#38;&#x26;&quot;'/>", "<a b='&lt;&#38;&#x26;&quot;'/>");
        repairs("<!-- don't & --><a/>", "<!-- don't & --><a/>");
        repairs("<![CDATA[ & ]]>\u{fc}&", "<![CDATA[ & ]]>\u{fc}&amp;");
    }
}
