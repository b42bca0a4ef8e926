//! The code of a file without what is not compiled into the library: comments, texts and tests.

/// Code in which comments, the contents of string and character literals, and items marked `#[cfg(test)]`
/// are blanked out.
pub(crate) fn code(text: &str) -> String {
    without_tests(&without_texts(text))
}

/// Blanks comments and the contents of literals.
pub(crate) fn without_texts(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let mut at = 0;
    while at < chars.len() {
        let end = end_of_text(&chars, at);
        if end == at {
            out.push(chars[at]);
            at += 1;
        } else {
            out.push(' ');
            at = end;
        }
    }
    out
}

/// Where a comment or literal that starts at `at` ends; `at` itself where none starts.
fn end_of_text(chars: &[char], at: usize) -> usize {
    let next = |k: usize| chars.get(at + k).copied().unwrap_or('\n');
    match chars[at] {
        '/' if next(1) == '/' => find(chars, at, |c, _| c == '\n'),
        '/' if next(1) == '*' => end_of_block_comment(chars, at),
        '"' => end_of_string(chars, at),
        '\'' if next(1) == '\\' => find(chars, at + 3, |c, _| c == '\'') + 1,
        '\'' if next(2) == '\'' => at + 3,
        'r' if !(at > 0 && is_word(chars[at - 1]) && chars[at - 1] != 'b') => end_of_raw(chars, at),
        _ => at,
    }
}

/// The first position from `at` on that `is_end` accepts, or the end.
fn find(chars: &[char], at: usize, is_end: impl Fn(char, usize) -> bool) -> usize {
    (at..chars.len()).find(|&k| is_end(chars[k], k)).unwrap_or(chars.len())
}

fn end_of_block_comment(chars: &[char], start: usize) -> usize {
    let mut depth = 0;
    let mut at = start;
    while at + 1 < chars.len() {
        match [chars[at], chars[at + 1]] {
            ['/', '*'] => (depth, at) = (depth + 1, at + 2),
            ['*', '/'] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            return at;
        }
    }
    chars.len()
}

fn end_of_string(chars: &[char], start: usize) -> usize {
    let mut at = start + 1;
    while at < chars.len() && chars[at] != '"' {
        at += if chars[at] == '\\' { 2 } else { 1 };
    }
    (at + 1).min(chars.len())
}

/// The end of `r"…"` or `r#"…"#`.
fn end_of_raw(chars: &[char], start: usize) -> usize {
    let quote = find(chars, start + 1, |c, _| c != '#');
    if chars.get(quote) != Some(&'"') {
        return start;
    }
    let hashes = quote - start - 1;
    let closes = |k: usize| (1..=hashes).all(|i| chars.get(k + i) == Some(&'#'));
    (find(chars, quote + 1, |c, k| c == '"' && closes(k)) + 1 + hashes).min(chars.len())
}

pub(crate) fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Leaves out items marked `#[cfg(test)]`, in code without texts.
fn without_tests(code: &str) -> String {
    const MARK: &str = "#[cfg(test)]";
    let mut out = String::with_capacity(code.len());
    let mut rest = code;
    while let Some(start) = rest.find(MARK) {
        out.push_str(&rest[..start]);
        let item = &rest[start + MARK.len()..];
        rest = &item[end_of_item(item)..];
    }
    out + rest
}

/// Where the item ends that `code` starts with: behind its block, or behind a semicolon outside of all
/// brackets.
fn end_of_item(code: &str) -> usize {
    let is_import = code.split(|c| !is_word(c)).any(|word| word == "use");
    let is_import = is_import && !code.split("use").next().unwrap_or_default().contains(['{', ';']);
    let mut depth = 0;
    for (at, c) in code.char_indices() {
        match c {
            '{' | '(' | '[' => depth += 1,
            '}' | ')' | ']' => depth -= 1,
            _ => {}
        }
        let ends = if c == '}' { !is_import } else { c == ';' };
        if depth == 0 && ends {
            return at + 1;
        }
    }
    code.len()
}

#[test]
fn comments_and_literals_are_no_code() {
    let text = r##"a // crate::x "
        /* b /* c */ "d" */ e "crate::f \" \\" 'g' '\'' '"' &'h str br#"i " i"# number r"j\" k"##;
    let words: Vec<String> = without_texts(text).split_whitespace().map(String::from).collect();
    assert_eq!(words.join(" "), "a e &'h str b number k");
}

#[test]
fn tests_are_left_out() {
    let text = "a; #[cfg(test)] use crate::{b, c}; d; #[cfg(test)]\nmod tests { fn e() { f; } } g; \
                #[cfg(test)] mod far; h; #[cfg(test)] const I: [u8; 2] = [0; 2]; j; \
                #[cfg(test)] #[allow(unused)] fn used() -> u8 { 0 } k";
    let words: Vec<String> = code(text).split_whitespace().map(String::from).collect();
    assert_eq!(words.join(" "), "a; d; g; h; j; k");
}
