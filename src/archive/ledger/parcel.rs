//! Several arrays in one block: each with its width and length before it.

use std::path::PathBuf;

use bytemuck::{Pod, Zeroable};

use crate::{Error, Result};

/// What stands before each array.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Label {
    width: u64,
    count: u64,
}

const LABEL_BYTES: usize = size_of::<Label>();

/// Arrays one after another as they lie in memory, to be written without copying them.
#[derive(Default)]
pub struct Parts<'a>(Vec<Part<'a>>);

enum Part<'a> {
    Label(Label),
    Array(&'a [u8]),
}

impl<'a> Parts<'a> {
    /// Of one value.
    pub fn of(value: &'a impl Keep) -> Self {
        let mut parts = Self::default();
        value.put(&mut parts);
        parts
    }

    /// Puts an array.
    pub fn put<T: Pod>(&mut self, values: &'a [T]) {
        let label = Label { width: size_of::<T>() as u64, count: values.len() as u64 };
        self.0.extend([Part::Label(label), Part::Array(bytemuck::cast_slice(values))]);
    }

    /// Their bytes, in order.
    pub fn bytes(&self) -> Vec<&[u8]> {
        self.0
            .iter()
            .map(|part| match part {
                Part::Label(label) => bytemuck::bytes_of(label),
                Part::Array(bytes) => *bytes,
            })
            .collect()
    }
}

/// Arrays of a block that was read, taken in the order they were put.
#[derive(Debug, Default)]
pub struct Parcel {
    bytes: Vec<u8>,
    at: usize,
    file: PathBuf,
}

/// What goes into a block of a [`Ledger`](super::Ledger) and comes out equal.
pub trait Keep: Sized {
    /// Puts all arrays.
    fn put<'a>(&'a self, parts: &mut Parts<'a>);
    /// Takes the same arrays in the same order; an error says what was expected and what was there.
    ///
    /// # Errors
    /// A text for [`Error::Damaged`].
    fn take(parcel: &mut Parcel) -> Result<Self, String>;
}

impl Parcel {
    /// From the bytes of a block of `file`.
    pub fn from_bytes(bytes: Vec<u8>, file: PathBuf) -> Self {
        Self { bytes, at: 0, file }
    }

    /// Takes one value, which must be all there is.
    ///
    /// # Errors
    /// [`Error::Damaged`] in the block called `place`.
    pub fn open<K: Keep>(mut self, place: &str) -> Result<K> {
        let value = K::take(&mut self).and_then(|value| match self.bytes.len() - self.at {
            0 => Ok(value),
            more => Err(format!("expected the end, got {more} more bytes")),
        });
        value.map_err(|problem| Error::Damaged { file: self.file, place: place.into(), problem })
    }

    /// Takes an array.
    ///
    /// # Errors
    /// A text for [`Error::Damaged`].
    pub fn take<T: Pod>(&mut self) -> Result<Vec<T>, String> {
        let rest = &self.bytes[self.at..];
        let label: Label = rest
            .get(..LABEL_BYTES)
            .map(bytemuck::pod_read_unaligned)
            .ok_or_else(|| format!("expected a label of {LABEL_BYTES} bytes, got {}", rest.len()))?;
        if label.width != size_of::<T>() as u64 {
            return Err(format!("expected values of {} bytes, got {}", size_of::<T>(), label.width));
        }
        let rest = &rest[LABEL_BYTES..];
        let wanted = usize::try_from(label.count).ok().and_then(|count| count.checked_mul(size_of::<T>()));
        let Some(bytes) = wanted.and_then(|wanted| rest.get(..wanted)) else {
            return Err(format!("expected {} values, got {} bytes", label.count, rest.len()));
        };
        self.at += LABEL_BYTES + bytes.len();
        // The bytes may lie anywhere; their copy is aligned.
        let mut values = vec![T::zeroed(); label.count as usize];
        bytemuck::cast_slice_mut(&mut values).copy_from_slice(bytes);
        Ok(values)
    }
}

impl<T: Pod> Keep for Vec<T> {
    fn put<'a>(&'a self, parts: &mut Parts<'a>) {
        parts.put(self);
    }

    fn take(parcel: &mut Parcel) -> Result<Self, String> {
        parcel.take()
    }
}

/// A tuple keeps its members in order.
macro_rules! keep_tuple {
    ($($member:ident)*) => {
        impl<$($member: Keep),*> Keep for ($($member,)*) {
            #[expect(non_snake_case, reason = "members are called as their types are")]
            fn put<'a>(&'a self, parts: &mut Parts<'a>) {
                let ($($member,)*) = self;
                $($member.put(parts);)*
            }

            fn take(parcel: &mut Parcel) -> Result<Self, String> {
                Ok(($($member::take(parcel)?,)*))
            }
        }
    };
}
keep_tuple!(A B);
keep_tuple!(A B C);
keep_tuple!(A B C D);
keep_tuple!(A B C D E F);

/// A single value of fixed size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct One<T>(pub T);

impl<T: Pod> Keep for One<T> {
    fn put<'a>(&'a self, parts: &mut Parts<'a>) {
        parts.put(std::slice::from_ref(&self.0));
    }

    fn take(parcel: &mut Parcel) -> Result<Self, String> {
        match parcel.take::<T>()?.as_slice() {
            [value] => Ok(Self(*value)),
            values => Err(format!("expected one value, got {}", values.len())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_comes_out_equal() {
        let value =
            (vec![1.5_f32, f32::NAN], vec![7_u8; 3], One(0x1234_5678_9abc_def0_u64), Vec::<u16>::new());
        let (floats, bytes, one, none): (Vec<f32>, Vec<u8>, One<u64>, Vec<u16>) =
            Parcel::from_bytes(Parts::of(&value).bytes().concat(), "x".into()).open("block 0").unwrap();
        assert_eq!(
            floats.iter().map(|f| f.to_bits()).collect::<Vec<_>>(),
            [1.5_f32, f32::NAN].map(f32::to_bits)
        );
        assert_eq!((bytes, one, none.len()), (value.1, value.2, 0));
    }

    #[test]
    fn what_does_not_fit_is_damage_with_its_place() {
        let bytes = Parts::of(&vec![1_u32, 2]).bytes().concat();
        let parcel = || Parcel::from_bytes(bytes.clone(), "x".into());
        assert_eq!(parcel().open::<Vec<u32>>("b").unwrap(), [1, 2]);
        let refused = |error: Error| assert_eq!(error.exit_code(), 9, "{error}");
        refused(parcel().open::<Vec<u64>>("b").unwrap_err());
        refused(parcel().open::<One<u32>>("b").unwrap_err());
        refused(parcel().open::<(Vec<u32>, Vec<u32>)>("b").unwrap_err());
        let cut = Parcel::from_bytes(bytes[..20].to_vec(), "x".into());
        refused(cut.open::<Vec<u32>>("b").unwrap_err());
        // A claim of 2^61 values is refused before memory is asked for.
        let mut claim = bytes.clone();
        claim[15] = 0x20;
        refused(Parcel::from_bytes(claim, "x".into()).open::<Vec<u32>>("b").unwrap_err());
    }
}
