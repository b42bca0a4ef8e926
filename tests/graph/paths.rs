//! The paths that code names: in `use` declarations and in the midst of expressions and types.

use crate::code::is_word;

/// Names separated by `::`. A glob ends with `*`.
pub(crate) type Path = Vec<String>;

/// One leaf of a `use` declaration.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Use {
    pub(crate) path: Path,
    /// The name by which code of the module speaks of it.
    pub(crate) name: String,
}

/// What a module says about others.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Module {
    pub(crate) uses: Vec<Use>,
    /// Paths outside of `use` declarations, at least two names long.
    pub(crate) inline: Vec<Path>,
    /// Macros defined here, by name.
    pub(crate) macros: Vec<String>,
    /// Modules with a body of their own in this file.
    pub(crate) nested: Vec<(String, Module)>,
}

/// Reads the paths from code without comments, texts and tests.
pub(crate) fn parse(code: &str) -> Module {
    let tokens = tokens(code);
    Parser { tokens: &tokens, at: 0 }.module()
}

/// Words, `::`, and everything else character by character.
fn tokens(code: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let word = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
        let len = match word {
            0 if rest.starts_with("::") => 2,
            0 => first.len_utf8(),
            len => len,
        };
        tokens.push(&rest[..len]);
        rest = rest[len..].trim_start();
    }
    tokens
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

struct Parser<'a> {
    tokens: &'a [&'a str],
    at: usize,
}

impl Parser<'_> {
    /// The token `ahead` of the current one; empty beyond the end.
    fn token(&self, ahead: usize) -> &str {
        self.tokens.get(self.at + ahead).copied().unwrap_or_default()
    }

    /// The token `back` before the current one.
    fn before(&self, back: usize) -> &str {
        self.at.checked_sub(back).map_or("", |at| self.tokens[at])
    }

    /// Everything up to the brace that closes the module.
    fn module(&mut self) -> Module {
        let mut module = Module::default();
        let mut depth = 0;
        while self.at < self.tokens.len() {
            match self.token(0) {
                "use" if self.token(1) != "<" => {
                    self.at += 1;
                    self.tree(&mut Vec::new(), &mut module.uses);
                }
                "mod" if is_name(self.token(1)) && self.token(2) == "{" => {
                    let name = self.token(1).to_owned();
                    self.at += 3;
                    module.nested.push((name, self.module()));
                }
                "macro_rules" if self.token(1) == "!" && is_name(self.token(2)) => {
                    module.macros.push(self.token(2).to_owned());
                    self.at += 3;
                }
                "}" if depth == 0 => {
                    self.at += 1;
                    break;
                }
                "{" => (depth, self.at) = (depth + 1, self.at + 1),
                "}" => (depth, self.at) = (depth - 1, self.at + 1),
                token if is_name(token) => module.inline.extend(self.path()),
                _ => self.at += 1,
            }
        }
        module
    }

    /// A path in the midst of code; none where it is a single name, belongs to a longer path that starts
    /// with a type, or says in `pub(in …)` who may see something.
    fn path(&mut self) -> Option<Path> {
        let counts = self.before(1) != "::" && !(self.before(1) == "in" && self.before(2) == "(");
        let mut path = vec![self.token(0).to_owned()];
        self.at += 1;
        while self.token(0) == "::" && is_name(self.token(1)) {
            path.push(self.token(1).to_owned());
            self.at += 2;
        }
        (counts && path.len() > 1).then_some(path)
    }

    /// The rest of a use tree behind the names in `prefix`.
    fn tree(&mut self, prefix: &mut Path, uses: &mut Vec<Use>) {
        let len = prefix.len();
        if self.token(0) == "::" {
            self.at += 1;
        }
        while is_name(self.token(0)) {
            prefix.push(self.token(0).to_owned());
            self.at += 1;
            if self.token(0) != "::" {
                break;
            }
            self.at += 1;
        }
        match self.token(0) {
            "{" => {
                self.at += 1;
                while !["}", ""].contains(&self.token(0)) {
                    self.tree(prefix, uses);
                    if self.token(0) == "," {
                        self.at += 1;
                    }
                }
                self.at += 1;
            }
            "*" => {
                self.at += 1;
                let path = [prefix.as_slice(), &["*".to_owned()]].concat();
                uses.push(Use { path, name: "*".to_owned() });
            }
            _ => {
                // `use a::{self}` speaks of `a`.
                let path = match prefix.split_last() {
                    Some((last, rest)) if last == "self" && !rest.is_empty() => rest.to_vec(),
                    _ => prefix.clone(),
                };
                let mut name = path.last().cloned().unwrap_or_default();
                if self.token(0) == "as" {
                    name = self.token(1).to_owned();
                    self.at += 2;
                }
                if path.is_empty() {
                    // Not a use declaration that compiles: goes on behind it.
                    self.at += 1;
                } else {
                    uses.push(Use { path, name });
                }
            }
        }
        prefix.truncate(len);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uses(code: &str) -> Vec<String> {
        let leaf = |leaf: &Use| {
            let path = leaf.path.join("::");
            if leaf.path.last() == Some(&leaf.name) {
                path
            } else {
                format!("{path} as {}", leaf.name)
            }
        };
        parse(code).uses.iter().map(leaf).collect()
    }

    fn inline(code: &str) -> Vec<String> {
        parse(code).inline.iter().map(|path| path.join("::")).collect()
    }

    #[test]
    fn use_trees_are_taken_apart() {
        let code = "use crate::{a::b, c::{d, e}}; pub(crate) use super::f as g; pub use self::h::*; \
                    use i; use crate::j::{self, k::{self as l}, m as _,}; use ::n::o;";
        let expected = [
            "crate::a::b",
            "crate::c::d",
            "crate::c::e",
            "super::f as g",
            "self::h::*",
            "i",
            "crate::j",
            "crate::j::k as l",
            "crate::j::m as _",
            "n::o",
        ];
        assert_eq!(uses(code), expected);
    }

    #[test]
    fn inline_paths_are_found_where_they_start() {
        let code = "pub(in crate::no) fn f(x: crate::a::B<super::c::D>) -> impl Sized + use<'_> \
                    { crate::e::f::<u8>(g::h!()); for i in crate::j::K { Vec::<u8>::new(); } x.y }";
        let expected = ["crate::a::B", "super::c::D", "crate::e::f", "g::h", "crate::j::K"];
        assert_eq!(inline(code), expected);
    }

    #[test]
    fn nested_modules_are_apart_and_macros_known() {
        let code = "use a::b; mod c { use super::d; fn e() { f::g(); } } mod h; i::j!{} \
                    macro_rules! k { () => {} }";
        let module = parse(code);
        let (name, nested) = &module.nested[0];
        assert_eq!((name.as_str(), nested.uses[0].name.as_str()), ("c", "d"));
        assert_eq!(nested.inline, [["f", "g"]]);
        assert_eq!((module.uses.len(), module.inline.len()), (1, 1));
        assert_eq!(module.macros, ["k"]);
    }
}
