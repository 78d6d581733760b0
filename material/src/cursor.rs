//! Reading numbers out of bytes that need not be what they claim.

/// A place in a file's bytes. Whatever is asked for beyond the end is an error in words.
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The byte of the file that comes next.
    pub fn at(&self) -> u64 {
        self.at as u64
    }

    /// Goes on at a byte of the file.
    pub fn seek(&mut self, at: u64) -> Result<(), String> {
        self.at = usize::try_from(at)
            .ok()
            .filter(|&at| at <= self.bytes.len())
            .ok_or_else(|| self.ends(&format!("something at byte {at}")))?;
        Ok(())
    }

    /// The next bytes.
    pub fn take(&mut self, length: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(length).filter(|&end| end <= self.bytes.len());
        let end = end.ok_or_else(|| self.ends(&format!("{length} bytes at byte {}", self.at)))?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn ends(&self, wanted: &str) -> String {
        format!("expected {wanted}, but the file ends at byte {}", self.bytes.len())
    }

    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    pub fn u32(&mut self) -> Result<u32, String> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn i32(&mut self) -> Result<i32, String> {
        self.array().map(i32::from_le_bytes)
    }

    pub fn i64(&mut self) -> Result<i64, String> {
        self.array().map(i64::from_le_bytes)
    }

    pub fn f32(&mut self) -> Result<f32, String> {
        self.array().map(f32::from_le_bytes)
    }

    pub fn f64(&mut self) -> Result<f64, String> {
        self.array().map(f64::from_le_bytes)
    }

    /// Bytes after their number, 32 bits.
    pub fn counted(&mut self) -> Result<&'a [u8], String> {
        let length = self.u32()? as usize;
        self.take(length)
    }

    /// The same as text.
    pub fn text(&mut self) -> Result<String, String> {
        Ok(String::from_utf8_lossy(self.counted()?).into_owned())
    }
}
