//! The document of a glTF file and the bytes of its buffers, wherever these are.

use std::borrow::Cow;
use std::path::Path;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use crate::formats::gltf::accessor::Content;
use crate::formats::gltf::document::{Buffer, Document};
use crate::formats::text::{BYTE_ORDER_MARK, read_bytes};
use crate::scene::error::SceneError;

/// The document in the bytes of the file `path`, .glb or .gltf, and the bytes of its buffers, each as long as the
/// document says.
///
/// # Errors
/// [`SceneError::Json`], [`SceneError::File`] for what is wrong with the container, or [`SceneError::Gltf`]
/// or [`SceneError::Read`] for what is wrong with a buffer.
pub(crate) fn open<'a>(path: &Path, bytes: &'a [u8]) -> Result<Content<'a>, SceneError> {
    let refusal = |expected| SceneError::File { path: path.to_owned(), expected };
    let Chunks { json, binary } = chunks(bytes).map_err(refusal)?;
    let document: Document = serde_json::from_slice(json)
        .map_err(|source| SceneError::Json { path: path.to_owned(), source })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut buffers = Vec::new();
    for (index, buffer) in document.buffers.iter().enumerate() {
        let refusal = |expected| {
            let place = format!("buffer {index}");
            SceneError::Gltf { path: path.to_owned(), place, expected }
        };
        let content = match (source(buffer, index).map_err(refusal)?, binary) {
            (Source::File(name), _) => Cow::Owned(read_bytes(&folder.join(name))?),
            (Source::Data(bytes), _) => Cow::Owned(bytes),
            (Source::Chunk, Some(binary)) => Cow::Borrowed(binary),
            (Source::Chunk, None) => return Err(refusal("a uri, found none".to_owned())),
        };
        let (expected, found) = (buffer.byte_length, content.len());
        if found < expected {
            return Err(refusal(format!("{expected} bytes, found {found}")));
        }
        buffers.push(content);
    }
    Ok(Content { document, buffers })
}

/// The parts of a file.
#[derive(Clone, Copy, Debug)]
struct Chunks<'a> {
    json: &'a [u8],
    /// What follows the document in a binary file.
    binary: Option<&'a [u8]>,
}

/// What a binary file begins with.
const MAGIC: &[u8] = b"glTF";
/// Bytes of a binary file before its first chunk, and of a chunk before its content.
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// The parts of a binary file; a file that doesn't begin as these do is all document.
fn chunks(bytes: &[u8]) -> Result<Chunks<'_>, String> {
    if !bytes.starts_with(MAGIC) {
        let json = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
        return Ok(Chunks { json, binary: None });
    }
    let number = |at: usize| {
        let bytes = bytes.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
        bytes.map(u32::from_le_bytes)
    };
    let version = number(4).unwrap_or(0);
    if version != 2 {
        return Err(format!("version 2 of binary glTF, found {version}"));
    }
    let (expected, found) = (number(8).unwrap_or(0) as usize, bytes.len());
    if !(HEADER..=found).contains(&expected) {
        return Err(format!("{expected} bytes as its header says, found {found}"));
    }
    // A chunk from a place on: its kind, its content, and where it ends.
    let chunk = |at: usize| {
        let (length, kind) = (number(at)? as usize, number(at + 4)?);
        let first = at + CHUNK_HEADER;
        let end = first.checked_add(length)?;
        Some((kind.to_le_bytes(), bytes[..expected].get(first..end)?, end))
    };
    let Some((_, json, end)) = chunk(HEADER).filter(|(kind, ..)| kind == b"JSON") else {
        return Err("a chunk of JSON first".to_owned());
    };
    if end == expected {
        return Ok(Chunks { json, binary: None });
    }
    let Some((kind, binary, _)) = chunk(end) else {
        return Err("chunks that end with the file".to_owned());
    };
    // Chunks of other kinds are for others.
    Ok(Chunks { json, binary: (&kind == b"BIN\0").then_some(binary) })
}

/// Where the bytes of a buffer are.
enum Source {
    /// In a file beside the document.
    File(String),
    /// In its URI.
    Data(Vec<u8>),
    /// In the second chunk of a binary file.
    Chunk,
}

/// Where the bytes of a buffer of this index are.
fn source(buffer: &Buffer, index: usize) -> Result<Source, String> {
    let Some(uri) = &buffer.uri else {
        let is_first = index == 0;
        return if is_first { Ok(Source::Chunk) } else { Err("a uri, found none".to_owned()) };
    };
    let Some(data) = uri.strip_prefix("data:") else {
        // A scheme is longer than the letter of a drive.
        let scheme = uri.split_once(':').map_or("", |(scheme, _)| scheme);
        if scheme.len() > 1 && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric()) {
            return Err(format!("a relative path or `data:` as uri, found `{scheme}:`"));
        }
        return Ok(Source::File(unescaped(uri)));
    };
    let content = data.split_once(',').filter(|(kind, _)| kind.ends_with(";base64"));
    let Some((_, content)) = content else {
        return Err("data in base 64 as uri".to_owned());
    };
    let padding =
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    let decoded = GeneralPurpose::new(&STANDARD, padding).decode(content);
    decoded.map(Source::Data).map_err(|error| format!("data in base 64 as uri: {error}"))
}

/// A text in which `%20`, say, stands for a blank.
fn unescaped(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let [first, others @ ..] = rest {
        let digits = others.get(..2).filter(|_| *first == b'%');
        let digits = digits.and_then(|digits| std::str::from_utf8(digits).ok());
        match digits.and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &others[2..];
            }
            None => {
                bytes.push(*first);
                rest = others;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_unescaped() {
        for (uri, expected) in [
            ("a%20b.bin", "a b.bin"),
            ("%C3%A9.bin", "é.bin"),
            ("100%.bin", "100%.bin"),
            ("%4", "%4"),
        ] {
            assert_eq!(unescaped(uri), expected);
        }
    }

    #[test]
    fn containers_that_are_cut_or_of_another_version_are_refused() {
        let binary = |version: u32, length: u32, kind: &[u8; 4], size: u32| {
            let mut bytes = MAGIC.to_vec();
            bytes.extend([version, length, size].map(u32::to_le_bytes).concat());
            bytes.extend(kind);
            bytes.extend(b"{  }");
            bytes
        };
        let json = |bytes: &[u8]| chunks(bytes).map(|chunks| chunks.json.to_vec());
        assert_eq!(json(&binary(2, 24, b"JSON", 4)).expect("whole"), b"{  }");
        assert_eq!(json(b"\xef\xbb\xbf{}").expect("a document"), b"{}");
        for (bytes, expected) in [
            (binary(1, 24, b"JSON", 4), "version 2 of binary glTF, found 1"),
            (binary(2, 25, b"JSON", 4), "25 bytes as its header says, found 24"),
            (binary(2, 3, b"JSON", 4), "3 bytes as its header says, found 24"),
            (binary(2, 24, b"JSON", 5), "a chunk of JSON first"),
            (binary(2, 24, b"JSON", u32::MAX), "a chunk of JSON first"),
            (binary(2, 24, b"JSON", 3), "chunks that end with the file"),
            (binary(2, 24, b"BIN\0", 4), "a chunk of JSON first"),
            (MAGIC.to_vec(), "version 2 of binary glTF, found 0"),
        ] {
            assert_eq!(json(&bytes).expect_err(expected), expected);
        }
    }

    #[test]
    fn uris_of_other_kinds_are_refused() {
        for (uri, expected) in [
            ("https://a.example/b.bin", "a relative path or `data:` as uri, found `https:`"),
            ("data:text/plain,abc", "data in base 64 as uri"),
            ("data:a;base64,@@@@", "data in base 64 as uri: Invalid symbol"),
        ] {
            let buffer = Buffer { uri: Some(uri.to_owned()), byte_length: 3 };
            let Err(found) = source(&buffer, 0) else { panic!("{uri} is not refused") };
            assert!(found.starts_with(expected), "{found}");
        }
    }
}
