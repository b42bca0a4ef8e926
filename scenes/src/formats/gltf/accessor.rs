//! Numbers in the buffers of a glTF asset, every index and length of them checked.

use std::borrow::Cow;

use crate::formats::gltf::document::{Accessor, BufferView, Document};

/// A document with the bytes of its buffers.
#[derive(Debug)]
pub(crate) struct Content<'a> {
    pub(crate) document: Document,
    pub(crate) buffers: Vec<Cow<'a, [u8]>>,
}

impl Content<'_> {
    /// The entries of an accessor, of `WIDTH` numbers each. Those of normalised integers are fractions.
    ///
    /// # Errors
    /// What was expected instead of what is there.
    pub(crate) fn numbers<const WIDTH: usize>(
        &self,
        accessor: usize,
    ) -> Result<Vec<[f64; WIDTH]>, String> {
        let Accessor { component_type, normalized, count, shape, .. } = self.accessor(accessor)?;
        let expected = SHAPES[WIDTH - 1];
        if shape != expected {
            return Err(format!("{expected}, found {shape} in accessor {accessor}"));
        }
        let component = Component::of(*component_type)?;
        let entry = |bytes: &[u8]| -> [f64; WIDTH] {
            std::array::from_fn(|k| {
                let bytes = &bytes[k * component.size()..][..component.size()];
                component.number(bytes, *normalized)
            })
        };
        let Accessor { buffer_view, byte_offset, sparse, .. } = self.accessor(accessor)?;
        let size = WIDTH * component.size();
        let mut entries: Vec<_> = match buffer_view {
            Some(view) => self.entries(*view, *byte_offset, *count, size)?.map(entry).collect(),
            None if sparse.is_none() => {
                return Err(format!("a buffer view of accessor {accessor}, found none"));
            }
            None if *count > MOST_ZEROS => {
                return Err(format!(
                    "{MOST_ZEROS} zeros at most in accessor {accessor}, found {count}"
                ));
            }
            None => vec![[0.0; WIDTH]; *count],
        };
        if let Some(sparse) = sparse {
            let places = &sparse.indices;
            let kind = Component::of(places.component_type)?;
            let indices =
                self.entries(places.buffer_view, places.byte_offset, sparse.count, kind.size())?;
            let values = &sparse.values;
            let values =
                self.entries(values.buffer_view, values.byte_offset, sparse.count, size)?;
            for (index, value) in indices.zip(values) {
                let index = kind.number(index, false) as usize;
                *entries.get_mut(index).ok_or_else(|| {
                    format!("sparse indices below {count} in accessor {accessor}, found {index}")
                })? = entry(value);
            }
        }
        Ok(entries)
    }

    /// The entries of an accessor of whole numbers.
    ///
    /// # Errors
    /// What was expected instead of what is there.
    pub(crate) fn indices(&self, accessor: usize) -> Result<Vec<usize>, String> {
        let found = self.accessor(accessor)?.component_type;
        match Component::of(found)? {
            Component::U8 | Component::U16 | Component::U32 => {
                Ok(self.numbers(accessor)?.into_iter().map(|[index]| index as usize).collect())
            }
            _ => Err(format!("unsigned integers as indices, found the component type {found}")),
        }
    }

    /// An accessor of the document.
    pub(crate) fn accessor(&self, index: usize) -> Result<&Accessor, String> {
        let accessors = &self.document.accessors;
        accessors
            .get(index)
            .ok_or_else(|| format!("an accessor below {}, found {index}", accessors.len()))
    }

    /// The bytes of `count` entries of a buffer view.
    fn entries(
        &self,
        view: usize,
        offset: usize,
        count: usize,
        size: usize,
    ) -> Result<impl Iterator<Item = &[u8]>, String> {
        let views = &self.document.buffer_views;
        let index = view;
        let view = views.get(view);
        let view =
            view.ok_or_else(|| format!("a buffer view below {}, found {index}", views.len()))?;
        let BufferView { buffer, byte_offset, byte_length, byte_stride } = *view;
        let bytes = self.buffers.get(buffer);
        let bytes = bytes
            .ok_or_else(|| format!("a buffer below {}, found {buffer}", self.buffers.len()))?;
        let end = byte_offset.checked_add(byte_length);
        let bytes = end.and_then(|end| bytes.get(byte_offset..end)).ok_or_else(|| {
            let length = bytes.len();
            format!("buffer view {index} within its {length} bytes, found {byte_length} from {byte_offset} on")
        })?;
        let stride = byte_stride.unwrap_or(size);
        if stride < size {
            return Err(format!(
                "a stride of {size} bytes or more in buffer view {index}, found {stride}"
            ));
        }
        let last =
            count.checked_sub(1).ok_or_else(|| "one entry or more, found none".to_owned())?;
        let end =
            last.checked_mul(stride).and_then(|last| last.checked_add(offset)?.checked_add(size));
        if end.is_none_or(|end| end > bytes.len()) {
            let found = bytes.len();
            return Err(format!(
                "{count} entries of {size} bytes from {offset} on, {stride} apart, in buffer view {index}, \
                 found {found} bytes"
            ));
        }
        Ok((0..count).map(move |k| &bytes[offset + k * stride..][..size]))
    }
}

/// The names of entries by how many numbers they are.
const SHAPES: [&str; 4] = ["SCALAR", "VEC2", "VEC3", "VEC4"];
/// Entries without any bytes at most.
const MOST_ZEROS: usize = 1 << 20;

/// How a number is stored, the lowest byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Result<Self, String> {
        match code {
            5120 => Ok(Self::I8),
            5121 => Ok(Self::U8),
            5122 => Ok(Self::I16),
            5123 => Ok(Self::U16),
            5125 => Ok(Self::U32),
            5126 => Ok(Self::F32),
            _ => Err(format!("a component type from 5120 to 5126 but 5124, found {code}")),
        }
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// The number in as many bytes as it has.
    fn number(self, bytes: &[u8], normalized: bool) -> f64 {
        let mut word = [0; 4];
        word[..bytes.len()].copy_from_slice(bytes);
        let [a, b, ..] = word;
        let (value, largest) = match self {
            Self::I8 => (f64::from(a as i8), f64::from(i8::MAX)),
            Self::U8 => (f64::from(a), f64::from(u8::MAX)),
            Self::I16 => (f64::from(i16::from_le_bytes([a, b])), f64::from(i16::MAX)),
            Self::U16 => (f64::from(u16::from_le_bytes([a, b])), f64::from(u16::MAX)),
            Self::U32 => (f64::from(u32::from_le_bytes(word)), f64::from(u32::MAX)),
            Self::F32 => return f64::from(f32::from_le_bytes(word)),
        };
        if normalized { (value / largest).max(-1.0) } else { value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The content of a document with one buffer of these bytes.
    fn content(accessors: &str, views: &str, bytes: &[u8]) -> Content<'static> {
        let text = format!("{{\"accessors\": [{accessors}], \"bufferViews\": [{views}]}}");
        let document = serde_json::from_str(&text).expect("valid");
        Content { document, buffers: vec![Cow::Owned(bytes.to_vec())] }
    }

    const WHOLE: &str = "{\"buffer\": 0, \"byteLength\": 24}";

    #[test]
    fn numbers_of_all_kinds_are_read_with_strides_and_offsets() {
        let bytes: Vec<u8> = (0..24).map(|k| 10 * k).collect();
        let view = "{\"buffer\": 0, \"byteOffset\": 4, \"byteLength\": 20, \"byteStride\": 4}";
        for (kind, normalized, expected) in [
            (5121, false, [50.0, 90.0]),
            (5121, true, [50.0 / 255.0, 90.0 / 255.0]),
            (5120, false, [50.0, 90.0]),
            (5123, false, [50.0 + 256.0 * 60.0, 90.0 + 256.0 * 100.0]),
        ] {
            let accessor = format!(
                "{{\"bufferView\": 0, \"byteOffset\": 1, \"componentType\": {kind}, \"count\": 2, \
                 \"normalized\": {normalized}, \"type\": \"SCALAR\"}}"
            );
            let found = content(&accessor, view, &bytes).numbers::<1>(0).expect("there");
            assert_eq!(found, expected.map(|x| [x]));
        }
        assert_eq!(Component::I8.number(&[0x80], true), -1.0);
        assert_eq!(Component::F32.number(&1.5f32.to_le_bytes(), false), 1.5);
    }

    #[test]
    fn sparse_entries_take_the_place_of_others_or_of_zeros() {
        let sparse = "\"sparse\": {\"count\": 1, \"indices\": {\"bufferView\": 0, \"byteOffset\": 2, \
            \"componentType\": 5121}, \"values\": {\"bufferView\": 0, \"byteOffset\": 8}}";
        for (own, expected) in [("\"bufferView\": 0, ", [0.0, 1.0, 8.0]), ("", [0.0, 0.0, 8.0])] {
            let accessor = format!(
                "{{{own}\"componentType\": 5121, \"count\": 3, \"type\": \"SCALAR\", {sparse}}}"
            );
            let bytes: Vec<u8> = (0..24).collect();
            let found = content(&accessor, WHOLE, &bytes).numbers::<1>(0).expect("there");
            assert_eq!(found, expected.map(|x| [x]));
            let few = accessor.replace("\"count\": 3", "\"count\": 2");
            let found = content(&few, WHOLE, &bytes).numbers::<1>(0);
            assert_eq!(found.expect_err("two"), "sparse indices below 2 in accessor 0, found 2");
        }
    }

    #[test]
    fn what_is_not_there_is_told() {
        let accessor = "{\"bufferView\": 0, \"byteOffset\": 0, \"componentType\": 5126, \"count\": 2, \
            \"type\": \"VEC3\"}";
        let error = |from: &str, to: &str| {
            let (accessor, view) = (accessor.replacen(from, to, 1), WHOLE.replacen(from, to, 1));
            content(&accessor, &view, &[0; 24]).numbers::<3>(0).expect_err(to)
        };
        for (from, to, expected) in [
            ("VEC3", "VEC2", "VEC3, found VEC2 in accessor 0"),
            ("5126", "5124", "a component type from 5120 to 5126 but 5124, found 5124"),
            ("\"bufferView\": 0", "\"bufferView\": 1", "a buffer view below 1, found 1"),
            ("\"bufferView\": 0, ", "", "a buffer view of accessor 0, found none"),
            ("\"buffer\": 0", "\"buffer\": 3", "a buffer below 1, found 3"),
            (
                "\"byteLength\": 24",
                "\"byteLength\": 25",
                "buffer view 0 within its 24 bytes, found 25 from 0 on",
            ),
            ("\"count\": 2", "\"count\": 0", "one entry or more, found none"),
            (
                "\"count\": 2",
                "\"count\": 3",
                "3 entries of 12 bytes from 0 on, 12 apart, in buffer view 0, found 24 bytes",
            ),
            (
                "\"byteOffset\": 0",
                "\"byteOffset\": 18446744073709551615",
                "2 entries of 12 bytes from 18446744073709551615 on, 12 apart, in buffer view 0, found 24 bytes",
            ),
            (
                "\"byteLength\": 24",
                "\"byteLength\": 24, \"byteStride\": 4",
                "a stride of 12 bytes or more in buffer view 0, found 4",
            ),
        ] {
            assert_eq!(error(from, to), expected);
        }
        let content = content(accessor, WHOLE, &[0; 24]);
        assert_eq!(content.numbers::<3>(1).expect_err("one"), "an accessor below 1, found 1");
        let expected = "unsigned integers as indices, found the component type 5126";
        assert_eq!(content.indices(0).expect_err("floats"), expected);
    }
}
