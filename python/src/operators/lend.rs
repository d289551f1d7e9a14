//! Arrays over memory that a step borrows: the one file of the package with unsafe code.
//!
//! A sample of an input is in shared memory that is given back after the step, so an array over it must not outlive the
//! step. Arrays cannot be revoked, but they can be counted: the base of each array is an object that holds a token, and
//! whatever reads the bytes (an array, a slice of it, a memoryview, a generator, an exception that was caught) holds
//! that object. [`lend`] returns only when no such object is left; else the process ends.
//!
//! Not seen: an address that was taken as a number (`array.ctypes.data`), and C code that keeps a pointer without
//! a reference.
#![allow(unsafe_code)]

use std::marker::PhantomData;
use std::sync::Arc;

use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// What the arrays of a step hold.
#[pyclass(frozen, module = "stillpoint_rt._native")]
struct Lent {
    _token: Arc<()>,
}

/// Makes arrays over bytes that live for `'b`.
pub struct Loan<'b> {
    token: Arc<()>,
    bytes: PhantomData<&'b [u8]>,
}

/// Does work with arrays over bytes that outlive this call. Where an array is still held after the work, `held` reports it,
/// and the process ends.
pub fn lend<'b, R>(py: Python<'_>, work: impl FnOnce(&Loan<'b>) -> R, held: impl FnOnce()) -> R {
    let unwinding = AbortOnDrop;
    let loan = Loan { token: Arc::new(()), bytes: PhantomData };
    let result = work(&loan);
    if !loan.is_over(py) {
        held();
        std::process::abort();
    }
    std::mem::forget(unwinding);
    result
}

/// Work that panics leaves arrays of which nobody knows.
struct AbortOnDrop;

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        std::process::abort();
    }
}

impl<'b> Loan<'b> {
    /// A read-only array over bytes.
    ///
    /// # Errors
    /// The interpreter has no memory for it.
    pub fn array<'py>(&self, py: Python<'py>, bytes: &'b [u8]) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let base = Bound::new(py, Lent { _token: self.token.clone() })?.into_any();
        // SAFETY: the bytes outlive the call of `lend`, and that does not return while anything holds the base of this
        // array. The array is made read-only before anyone sees it, and its base has no buffer, so numpy refuses to make
        // it writeable.
        let array = unsafe { PyArray1::borrow_from_array(&ArrayView1::from(bytes), base) };
        array.readwrite().make_nonwriteable();
        Ok(array)
    }

    /// Whether nothing holds an array.
    fn is_over(&self, py: Python<'_>) -> bool {
        if Arc::strong_count(&self.token) > 1 {
            // Arrays in cycles of objects are held by nothing else: a collection frees them.
            let _ = py.import("gc").and_then(|gc| gc.call_method0("collect"));
        }
        Arc::strong_count(&self.token) == 1
    }
}
