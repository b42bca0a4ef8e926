//! What is refused, where, and with which words; and that no text does harm.

use farfield::Kernel;
use farfield::glam::DVec3;
use farfield_formula::TextFormula;
use farfield_testing::damage::for_each_damaged;

/// A text, the character that is wrong (from 1), and words of the message.
const REFUSED: [(&str, usize, &str); 44] = [
    ("", 1, "expected a number, a name or (, found the end of the text"),
    ("1/", 3, "expected a number, a name or (, found the end of the text"),
    ("*r", 1, "found \"*\""),
    ("1//r", 3, "found \"/\""),
    ("2 r", 3, "expected an operator, or the end of the text, found \"r\""),
    ("r)", 2, "found \")\""),
    ("(r", 3, "expected an operator, or ) for the bracket that was opened"),
    ("exp(-r", 7, "expected an operator, a comma, or ) after the arguments"),
    ("exp -r", 1, "\"exp\" is a function: expected ( after it"),
    ("exp()", 1, "exp with 0 arguments: expected 1"),
    ("exp(r, 2)", 1, "exp with 2 arguments: expected 1"),
    ("min(r)", 1, "min with 1 arguments: expected 2 or more"),
    ("expp(r)", 1, "there is no function \"expp\": expected exp perhaps"),
    ("sinh(r)", 1, "expected sin perhaps"),
    ("gamma(r)", 1, "expected one of exp log sqrt"),
    ("r(2)", 1, "\"r\" is no function: expected an operator before (, such as r*("),
    ("R", 1, "the name \"R\" is unknown: expected r perhaps"),
    ("d4", 1, "expected d1 perhaps"),
    ("kapa*r + k", 1, "expected kappa perhaps"),
    ("exp(-q*r)", 6, "the name \"q\" is unknown"),
    ("exp(i*r)/r", 5, "i stands for the imaginary unit"),
    ("r < 1", 3, "a comparison gives no number"),
    ("(r < 1)*r", 4, "expected it as the first argument of where"),
    ("where(r, 1, 2)", 8, "expected one of < <= > >= == !="),
    ("where(r = 1, 1, 2)", 9, "found \"=\""),
    ("where(r < 1 < 2, 1, 2)", 13, "a comparison gives no number"),
    ("where(r < 1, 1)", 1, "where with 2 arguments: expected 3"),
    ("where(r < 1)", 1, "where with 1 arguments: expected 3"),
    ("where(r < 1, 1, 2, 3)", 1, "where with 4 arguments: expected 3"),
    ("min(r < 1, 2)", 7, "a comparison gives no number"),
    ("1.2.3*r", 1, "\"1.2.3\" is no number"),
    ("r + 1e999", 5, "\"1e999\" is no number"),
    ("r $ 2", 3, "'$' is no part of a formula"),
    ("r*ü", 3, "the name \"ü\" is unknown"),
    ("r + 1/0", 6, "this is inf at all points"),
    ("log(-1)", 1, "this is NaN at all points"),
    ("[1, r]", 2, "expected [ at the start of a row"),
    ("[[1, r]", 8, "] at the end of the tensor"),
    ("[[1, r], [1]]", 10, "a row of 1 entries: expected 2"),
    ("[[1, r], []]", 11, "found \"]\""),
    ("[]", 2, "expected [ at the start of a row"),
    ("2*[[1]]", 3, "a tensor is a list of rows"),
    ("[[1]] + 1", 7, "expected an operator, or the end of the text"),
    ("r ^", 4, "found the end of the text"),
];

#[test]
fn errors_point_at_the_character_and_say_what_was_expected() {
    for (text, character, words) in REFUSED {
        let parameters: &[_] =
            if text.contains("kapa") { &[("kappa", 1.0), ("k", 2.0)] } else { &[] };
        let error = TextFormula::new(text, parameters).expect_err(text);
        let message = error.to_string();
        assert_eq!(error.position(), Some(character - 1), "{message}");
        assert!(message.contains(words), "{message}");
        let lines: Vec<_> = message.lines().collect();
        let caret = lines[2].chars().count();
        assert!(lines.len() == 3 && lines[2].ends_with('^'), "{message}");
        assert!(caret == character + 2 && lines[0].contains("expected"), "{message}");
    }
}

#[test]
fn parameters_are_those_of_the_text() {
    for (text, parameters, words) in [
        ("exp(-k*r)", &[][..], "the name \"k\" is unknown"),
        ("exp(-k*r)", &[("K", 1.0)], "the name \"k\" is unknown: expected K perhaps"),
        (
            "exp(-k*r)",
            &[("k", 1.0), ("s", 2.0)],
            "\"s\" does not occur in the text: expected only k",
        ),
        ("1/r", &[("k", 1.0)], "\"k\" does not occur in the text: expected none"),
        ("k*r", &[("k", 1.0), ("k", 1.0)], "the parameter \"k\" has two values"),
        ("k*r", &[("k", f64::NAN)], "the parameter \"k\" is NaN: expected a finite number"),
        ("r", &[("r", 1.0)], "a parameter can't have the name \"r\""),
        ("r", &[("exp", 1.0)], "a parameter can't have the name \"exp\""),
        ("r", &[("i", 1.0)], "a parameter can't have the name \"i\""),
        ("r", &[("2k", 1.0)], "a parameter can't have the name \"2k\""),
        ("r", &[("", 1.0)], "a parameter can't have the name \"\""),
    ] {
        let error = TextFormula::new(text, parameters).expect_err(text);
        assert!(error.to_string().contains(words), "{error}");
        assert_eq!(error.position().is_some(), words.contains("unknown"), "{error}");
    }
    assert!(TextFormula::new("length_1*r", &[("length_1", 2.0)]).is_ok());
}

#[test]
fn long_texts_show_their_part_around_the_error() {
    let text = format!("{}$ + r", "r + ".repeat(500));
    let error = TextFormula::new(&text, &[]).unwrap_err();
    let message = error.to_string();
    let [_, shown, caret] = message.lines().collect::<Vec<_>>()[..] else { panic!("{message}") };
    assert!(shown.len() < 100 && shown.as_bytes()[caret.len() - 1] == b'$', "{message}");
}

#[test]
fn depth_and_length_are_bounded() {
    let nested = |open: &str, n: usize, close: &str| open.repeat(n) + "r" + &close.repeat(n);
    for (open, close) in
        [("(", ")"), ("-", ""), ("2^", ""), ("exp(", ")"), ("where(r<", ",1,2)"), ("[", "]")]
    {
        for n in [101, 100_000] {
            let error = TextFormula::new(&nested(open, n, close), &[]).unwrap_err().to_string();
            assert!(error.contains("deep in each other") || open == "[", "{error}");
        }
        assert!(TextFormula::new(&nested(open, 30, close), &[]).is_ok() || open == "[");
    }
    // A long text is no deep one.
    let sum = |n: usize| "r".to_owned() + &" + r".repeat(n);
    assert!(TextFormula::new(&sum(4000), &[]).is_ok());
    assert!(TextFormula::new(&sum(100_000), &[]).is_err());
    // Of what occurs a hundred thousand times, one operation is left.
    assert!(TextFormula::new(&("r".to_owned() + &"/r*r".repeat(100_000)), &[]).is_err());
    assert!(TextFormula::new(&format!("min(r{})", ",r".repeat(100_000)), &[]).is_ok());
    let long: Vec<String> = (0..5000).map(|k| format!("exp({k}*r)")).collect();
    let error = TextFormula::new(&long.join("+"), &[]).unwrap_err().to_string();
    assert!(error.contains("more than 4096 operations"), "{error}");
    let wide = format!("[[{}]]", vec!["r"; 17].join(","));
    assert!(
        TextFormula::new(&wide, &[])
            .unwrap_err()
            .to_string()
            .contains("more than 16 rows or columns")
    );
    let tall = format!("[{}]", vec!["[r]"; 17].join(","));
    assert!(
        TextFormula::new(&tall, &[])
            .unwrap_err()
            .to_string()
            .contains("more than 16 rows or columns")
    );
}

/// Damaged copies of each text without the environment's asking for more.
const COPIES: u64 = 400;

#[test]
fn damaged_texts_are_read_or_refused() {
    let samples = [
        "exp(-k*r)/r + where(r2 <= 1e-3, min(d1, x2, -y3), erf(r)^2.5)",
        "[[k/r + d1*d1/r^3, d1*d2/r^3], [d2*d1/r^3, -2^-r^2]]",
        "log(k + r2) * tanh(abs(d1 - d3)) ** 3 - sqrt(x1*y1) / max(r, 0.5)",
        "k/r",
    ];
    let samples = samples.map(str::as_bytes);
    let (mut read, mut refused) = (0, 0);
    let (x, y) = (DVec3::new(0.3, 0.4, 0.5), DVec3::new(-0.2, 0.1, 2.0));
    for_each_damaged(&samples, COPIES, |_, bytes| {
        let text = String::from_utf8_lossy(bytes);
        match TextFormula::new(&text, &[("k", 1.0)]) {
            Ok(formula) => {
                // Whatever it is, it can be evaluated, with all its derivatives.
                let kernel = formula.kernel::<DVec3, Vec<f64>, Vec<f64>>().with_columns(1);
                let kernel = kernel.hessian::<Vec<f64>>();
                let charge = vec![1.0; formula.columns()];
                let mut sum = [Vec::new()];
                kernel.add_block(&[x], &[y], &[charge], 0.0, &mut sum);
                assert_eq!(sum[0].len(), 10 * formula.rows(), "{text}");
                read += 1;
            }
            Err(error) => {
                assert!(error.position() <= Some(text.chars().count()), "{error}");
                let lines = if error.position().is_some() { 3 } else { 1 };
                assert_eq!(error.to_string().lines().count(), lines, "{error}");
                refused += 1;
            }
        }
    });
    assert!(read > 50 && refused > 50, "{read} {refused}");
}
