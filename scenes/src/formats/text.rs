//! Text files, line by line and word by word.

use std::borrow::Cow;
use std::fs;
use std::path::Path;

use glam::DVec3;

use crate::scene::error::SceneError;

/// The bytes of a file.
///
/// # Errors
/// [`SceneError::Read`] if the system can't read it.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, SceneError> {
    fs::read(path).map_err(|source| SceneError::Read { path: path.to_owned(), source })
}

/// The text of a file without the byte order mark that some programs begin it with; what isn't UTF-8
/// in it, names mostly, is replaced.
///
/// # Errors
/// [`SceneError::Read`] if the system can't read it.
pub(crate) fn read_text(path: &Path) -> Result<String, SceneError> {
    Ok(text(&read_bytes(path)?).into_owned())
}

/// Bytes as a text, as [`read_text`] has it. Lines may end in a carriage return alone, and what begins with the mark of
/// UTF-16 is that.
pub(crate) fn text(bytes: &[u8]) -> Cow<'_, str> {
    let text = match bytes {
        [0xff, 0xfe, wide @ ..] => Cow::Owned(utf16(wide, u16::from_le_bytes)),
        [0xfe, 0xff, wide @ ..] => Cow::Owned(utf16(wide, u16::from_be_bytes)),
        _ => String::from_utf8_lossy(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes)),
    };
    let ends_lines = |(at, _)| !text[at + 1..].starts_with('\n');
    if text.match_indices('\r').any(ends_lines) {
        Cow::Owned(text.replace("\r\n", "\n").replace('\r', "\n"))
    } else {
        text
    }
}

/// The text of bytes in UTF-16; what isn't that in it is replaced.
fn utf16(bytes: &[u8], unit: impl Fn([u8; 2]) -> u16) -> String {
    let (pairs, _) = bytes.as_chunks::<2>();
    let units = pairs.iter().map(|&pair| unit(pair));
    char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

/// What some programs begin a text in UTF-8 with.
pub(crate) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The lines of a text that say something.
#[derive(Clone, Debug)]
pub(crate) struct Lines<'a> {
    path: &'a Path,
    rest: std::iter::Enumerate<std::str::Lines<'a>>,
    last: usize,
    /// First words of lines in which a `#` belongs to a name.
    named: &'static [&'static str],
    /// Whether a line that ends in a backslash goes on in the next one.
    continued: bool,
    /// What begins a comment.
    comment: &'static [char],
}

/// A line in words.
#[derive(Clone, Debug)]
pub(crate) struct Line<'a> {
    path: &'a Path,
    /// Its number, from 1; of several lines in one, that of the first.
    pub(crate) number: usize,
    /// Its words up to a comment; at least one.
    pub(crate) words: Vec<&'a str>,
}

impl<'a> Lines<'a> {
    /// The lines of `text`, which is that of the file `path`.
    pub(crate) fn new(path: &'a Path, text: &'a str) -> Self {
        let rest = text.lines().enumerate();
        Self { path, rest, last: 1, named: &[], continued: false, comment: &['#'] }
    }

    /// The same lines, with comments that begin with any of these.
    pub(crate) fn commented(self, comment: &'static [char]) -> Self {
        Self { comment, ..self }
    }

    /// The lines of the text of an OBJ or MTL file. A backslash at the end of a line joins it to the next
    /// one. After `named` first words a name follows, to which a `#` belongs.
    pub(crate) fn wavefront(path: &'a Path, text: &'a str, named: &'static [&'static str]) -> Self {
        Self { named, continued: true, ..Self::new(path, text) }
    }

    /// The next line.
    ///
    /// # Errors
    /// [`SceneError::Line`] at the end of the file, with `expected`.
    pub(crate) fn expect(&mut self, expected: &str) -> Result<Line<'a>, SceneError> {
        self.next().ok_or_else(|| SceneError::Line {
            path: self.path.to_owned(),
            line: self.last,
            expected: format!("{expected}, found the end of the file"),
        })
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        loop {
            let (index, first) = self.rest.next()?;
            let number = index + 1;
            let mut words = Vec::new();
            let mut part = first;
            while self.add_words(part, &mut words)
                && let Some((_, next)) = self.rest.next()
            {
                part = next;
            }
            if !words.is_empty() {
                self.last = number;
                return Some(Line { path: self.path, number, words });
            }
        }
    }
}

impl<'a> Lines<'a> {
    /// Adds the words of a line, or of a part of it, up to a comment. Returns whether the line goes on.
    fn add_words(&self, part: &'a str, words: &mut Vec<&'a str>) -> bool {
        let trimmed = part.trim();
        let first = words.first().copied().or_else(|| trimmed.split_whitespace().next());
        let is_named = first.is_some_and(|first| self.named.contains(&first));
        let comment = if is_named { None } else { trimmed.find(self.comment) };
        let said = &trimmed[..comment.unwrap_or(trimmed.len())];
        let joined = said.strip_suffix('\\').filter(|_| self.continued && comment.is_none());
        words.extend(joined.unwrap_or(said).split_whitespace());
        joined.is_some()
    }
}

impl Line<'_> {
    /// The refusal of this line.
    pub(crate) fn refusal(&self, expected: impl Into<String>) -> SceneError {
        let expected = expected.into();
        SceneError::Line { path: self.path.to_owned(), line: self.number, expected }
    }

    /// The three finite numbers from word `first` on; more words may follow.
    ///
    /// # Errors
    /// [`SceneError::Line`] if they aren't there.
    pub(crate) fn numbers(&self, first: usize) -> Result<[f64; 3], SceneError> {
        let number = |k: usize| {
            let number = self.words.get(first + k)?.parse().ok()?;
            f64::is_finite(number).then_some(number)
        };
        match (number(0), number(1), number(2)) {
            (Some(x), Some(y), Some(z)) => Ok([x, y, z]),
            _ => Err(self.refusal(format!("three finite numbers, found {}", self.quoted()))),
        }
    }

    /// The point at the coordinates from word `first` on.
    ///
    /// # Errors
    /// [`SceneError::Line`] if they aren't there.
    pub(crate) fn point(&self, first: usize) -> Result<DVec3, SceneError> {
        self.numbers(first).map(DVec3::from_array)
    }

    /// The line as a message shows it.
    pub(crate) fn quoted(&self) -> String {
        const SHOWN: usize = 60;
        let line = self.words.join(" ");
        match line.char_indices().nth(SHOWN) {
            Some((end, _)) => format!("`{}...`", &line[..end]),
            None => format!("`{line}`"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_numbered_and_comments_left_out() {
        let text = "# a comment\n\nv 1 2 3 # here\r\n  f 1 x nan\n";
        let mut lines = Lines::new(Path::new("a.obj"), text);
        let line = lines.next().expect("a line");
        assert_eq!(line.words, ["v", "1", "2", "3"]);
        assert_eq!(line.point(1).expect("numbers"), DVec3::new(1.0, 2.0, 3.0));
        let line = lines.next().expect("another line");
        let error = line.numbers(1).expect_err("not numbers").to_string();
        assert_eq!(error, "a.obj, line 4: expected three finite numbers, found `f 1 x nan`");
        let error = lines.expect("a face").expect_err("no more lines").to_string();
        assert_eq!(error, "a.obj, line 4: expected a face, found the end of the file");
    }

    #[test]
    fn lines_of_wavefront_files_go_on_and_keep_the_signs_in_names() {
        let text = "use Wall #1\nv 1 \\\n  2 \\\r\n3 # \\\n#x \\\nuse a \\\n#2\nv 4\\";
        let lines = Lines::wavefront(Path::new("a.obj"), text, &["use"]);
        let found: Vec<_> = lines.map(|line| (line.number, line.words.join(" "))).collect();
        let expected = [(1, "use Wall #1"), (2, "v 1 2 3"), (6, "use a #2"), (8, "v 4")];
        assert_eq!(found, expected.map(|(number, line)| (number, line.to_owned())));
        let plain: Vec<_> = Lines::new(Path::new("a.off"), "1 \\\n2").map(|l| l.number).collect();
        assert_eq!(plain, [1, 2]);
    }

    #[test]
    fn a_byte_order_mark_is_passed_over() {
        assert_eq!(text(b"\xef\xbb\xbfv 1"), "v 1");
        assert_eq!(text(b"v\xff"), "v\u{fffd}");
        assert_eq!(text(b"\xff\xfev\0 \x001\0"), "v 1");
        assert_eq!(text(b"\xfe\xff\0v\0 \x001"), "v 1");
    }

    #[test]
    fn lines_end_in_any_way() {
        assert_eq!(text(b"a\rb\r\nc\n\rd\r"), "a\nb\nc\n\nd\n");
        assert!(matches!(text(b"a\r\nb"), Cow::Borrowed("a\r\nb")));
    }

    #[test]
    fn long_lines_are_shown_in_part() {
        let text = "é".repeat(100);
        let line = Lines::new(Path::new("a"), &text).next().expect("a line");
        assert_eq!(line.quoted().chars().count(), 65);
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = read_text(Path::new("no/such/file")).expect_err("missing").to_string();
        assert!(error.starts_with("cannot read no/such/file: "), "{error}");
    }
}
