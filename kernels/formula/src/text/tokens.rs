//! Characters to numbers, names and signs.

use crate::text::error::{Problem, TextError};
use crate::text::names::{continues_name, starts_name};

/// A piece of a text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Token {
    Number(f64),
    Name(String),
    /// An operator, a bracket or a comma. `**` is `^`.
    Sign(&'static str),
    End,
}

impl Token {
    /// How errors call it.
    pub(crate) fn describe(&self) -> String {
        match self {
            Self::Number(x) => format!("the number {x}"),
            Self::Name(name) => format!("{name:?}"),
            Self::Sign(sign) => format!("{sign:?}"),
            Self::End => "the end of the text".to_owned(),
        }
    }
}

/// Signs, the longer ones first.
const SIGNS: [&str; 20] = [
    "**", "<=", ">=", "==", "!=", "+", "-", "*", "/", "^", "(", ")", "[", "]", ",", "<", ">", "=",
    "−", "·",
];

/// The pieces of a text, each with the place of its first character. O(n).
pub(crate) fn tokens(text: &str) -> Result<Vec<(usize, Token)>, TextError> {
    let characters: Vec<char> = text.chars().collect();
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(&c) = characters.get(at) {
        let start = at;
        let rest = &characters[start..];
        if c.is_whitespace() {
            at += 1;
            continue;
        }
        let token = if c.is_ascii_digit() || c == '.' {
            at += number_len(rest);
            let digits: String = characters[start..at].iter().collect();
            match digits.parse::<f64>() {
                Ok(x) if x.is_finite() => Token::Number(x),
                _ => return Err(TextError::new(text, start, Problem::Number { found: digits })),
            }
        } else if starts_name(c) {
            at += rest.iter().take_while(|c| continues_name(**c)).count();
            Token::Name(characters[start..at].iter().collect())
        } else {
            let begins = |sign: &&str| {
                let mut rest = rest.iter();
                sign.chars().all(|c| rest.next() == Some(&c))
            };
            let Some(sign) = SIGNS.into_iter().find(begins) else {
                return Err(TextError::new(text, start, Problem::Character { found: c }));
            };
            at += sign.chars().count();
            Token::Sign(match sign {
                "**" => "^",
                "−" => "-",
                "·" => "*",
                sign => sign,
            })
        };
        tokens.push((start, token));
    }
    tokens.push((characters.len(), Token::End));
    Ok(tokens)
}

/// How many characters belong to the number that begins here: digits, a point, digits, an exponent, and what
/// would make it another word.
fn number_len(rest: &[char]) -> usize {
    let mut len = 0;
    let digits = |len: &mut usize| {
        *len += rest[*len..].iter().take_while(|c| c.is_ascii_digit() || **c == '.').count();
    };
    digits(&mut len);
    if matches!(rest.get(len), Some('e' | 'E')) {
        let sign = usize::from(matches!(rest.get(len + 1), Some('+' | '-')));
        if rest.get(len + 1 + sign).is_some_and(char::is_ascii_digit) {
            len += 1 + sign;
            digits(&mut len);
        }
    }
    len
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_names_and_signs_are_told_apart() {
        let found: Vec<_> =
            tokens("1e-3*d1**.5<=e2").unwrap().into_iter().map(|(_, t)| t).collect();
        let name = |name: &str| Token::Name(name.to_owned());
        let expected = [
            Token::Number(1e-3),
            Token::Sign("*"),
            name("d1"),
            Token::Sign("^"),
            Token::Number(0.5),
            Token::Sign("<="),
            name("e2"),
            Token::End,
        ];
        assert_eq!(found, expected);
        assert_eq!(tokens("2e").unwrap()[1].1, name("e"), "an exponent has digits");
        for text in ["1.2.3", ".", "1e999", "2#3"] {
            assert!(tokens(text).is_err(), "{text}");
        }
    }
}
