//! The functions of FMI 3.0 (Modelica Association, 2022) in C; what a co-simulation of real numbers has no use for answers with an error.
//!
//! A panic ends at the border: the caller gets `fmi3Fatal`.

use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use super::instance::{Instance, InstanceError};

/// `fmi3Status`.
type Status = i32;
const OK: Status = 0;
const DISCARD: Status = 2;
const ERROR: Status = 3;
const FATAL: Status = 4;

/// `fmi3LogMessageCallback`.
type Log = Option<unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char)>;

/// An instance with its way to say what went wrong.
struct Held {
    instance: Instance,
    log: Log,
    environment: *mut c_void,
}

impl Held {
    fn tell(&self, status: Status, words: &str) {
        tell(self.log, self.environment, status, words);
    }
}

fn tell(log: Log, environment: *mut c_void, status: Status, words: &str) {
    let (Some(log), Ok(words)) = (log, CString::new(words)) else {
        return;
    };
    // SAFETY: the caller gave this function with its environment for this; both texts live until it returns.
    unsafe {
        log(
            environment,
            status,
            c"logStatusError".as_ptr(),
            words.as_ptr(),
        )
    }
}

/// Runs something with the instance behind a pointer.
///
/// # Safety
/// `instance` is null or what [`fmi3InstantiateCoSimulation`] gave, not freed since, and used by one thread at a time, as the standard asks.
unsafe fn with(
    instance: *mut c_void,
    work: impl FnOnce(&mut Instance) -> Result<(), InstanceError>,
) -> Status {
    // SAFETY: see above.
    let Some(held) = (unsafe { instance.cast::<Held>().as_mut() }) else {
        return ERROR;
    };
    let done = catch_unwind(AssertUnwindSafe(|| work(&mut held.instance)));
    match done {
        Ok(Ok(())) => OK,
        Ok(Err(error)) => {
            // A motion that runs away ends this step, not the program.
            let status = match &error {
                InstanceError::Trajectory(_) => DISCARD,
                _ => ERROR,
            };
            held.tell(status, &error.to_string());
            status
        }
        Err(_) => {
            held.tell(FATAL, "a defect in hydroline_fmu: please report it");
            FATAL
        }
    }
}

/// A text of C; empty where it is null or no UTF-8.
///
/// # Safety
/// Null, or a text that ends in 0 and lives as long as the result.
unsafe fn text<'a>(of: *const c_char) -> &'a str {
    if of.is_null() {
        return "";
    }
    // SAFETY: see above.
    unsafe { CStr::from_ptr(of) }.to_str().unwrap_or("")
}

/// Version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Takes any choice of what is logged: errors always are.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetDebugLogging(
    _instance: *mut c_void,
    _on: bool,
    _count: usize,
    _categories: *const *const c_char,
) -> Status {
    OK
}

/// Makes an instance from the resources; null where that fails, with the reason in the log.
///
/// # Safety
/// As the standard says: texts end in 0, the log function takes the environment.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging_on: bool,
    _event_mode_used: bool,
    _early_return_allowed: bool,
    _required_intermediate: *const u32,
    _required_count: usize,
    environment: *mut c_void,
    log: Log,
    _intermediate_update: *const c_void,
) -> *mut c_void {
    // SAFETY: texts of the caller, used until this returns.
    let (token, resources) = unsafe { (text(token), text(resources)) };
    let made = catch_unwind(|| Instance::read(Path::new(resources), token));
    match made {
        Ok(Ok(instance)) => {
            let held = Held {
                instance,
                log,
                environment,
            };
            Box::into_raw(Box::new(held)).cast()
        }
        Ok(Err(error)) => {
            tell(log, environment, ERROR, &error.to_string());
            std::ptr::null_mut()
        }
        Err(_) => std::ptr::null_mut(),
    }
}

/// Ends an instance.
///
/// # Safety
/// Null, or an instance that is used no more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: made by Box::into_raw of a Held, and given back once.
        drop(unsafe { Box::from_raw(instance.cast::<Held>()) });
    }
}

/// Takes the start of the run.
///
/// # Safety
/// An instance of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: *mut c_void,
    _tolerance_defined: bool,
    _tolerance: f64,
    start_s: f64,
    _stop_defined: bool,
    _stop_s: f64,
) -> Status {
    // Parameters may still come: the run begins when this mode ends.
    // SAFETY: the caller's.
    unsafe {
        with(instance, |i| {
            i.plan_start(start_s);
            Ok(())
        })
    }
}

/// Begins the run.
///
/// # Safety
/// An instance of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitInitializationMode(instance: *mut c_void) -> Status {
    // SAFETY: the caller's.
    unsafe { with(instance, Instance::begin_as_planned) }
}

/// Nothing is left to do at the end.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3Terminate(_instance: *mut c_void) -> Status {
    OK
}

/// Forgets the run.
///
/// # Safety
/// An instance of this library.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(instance: *mut c_void) -> Status {
    // SAFETY: the caller's.
    unsafe {
        with(instance, |i| {
            i.reset();
            Ok(())
        })
    }
}

/// Whether there is a place for the value of each variable that is referred to.
fn are_of_use(references: *const u32, values: *const f64, count: usize, places: usize) -> bool {
    count == places && (count == 0 || !(references.is_null() || values.is_null()))
}

/// Values of variables.
///
/// # Safety
/// An instance of this library; as many references and places for values as said.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut f64,
    places: usize,
) -> Status {
    if !are_of_use(references, values, count, places) {
        return ERROR;
    }
    // SAFETY: the caller's; each variable has one value.
    unsafe {
        with(instance, |i| {
            for k in 0..count {
                *values.add(k) = i.get(*references.add(k))?;
            }
            Ok(())
        })
    }
}

/// Sets variables.
///
/// # Safety
/// An instance of this library; as many references and values as said.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const f64,
    places: usize,
) -> Status {
    if !are_of_use(references, values, count, places) {
        return ERROR;
    }
    // SAFETY: the caller's; each variable has one value.
    unsafe {
        with(instance, |i| {
            for k in 0..count {
                i.set(*references.add(k), *values.add(k))?;
            }
            Ok(())
        })
    }
}

/// Moves over a step.
///
/// # Safety
/// An instance of this library; null, or places for what is said of the step.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    instance: *mut c_void,
    from_s: f64,
    step_s: f64,
    _no_state_set_before: bool,
    event_needed: *mut bool,
    terminate: *mut bool,
    early: *mut bool,
    reached_s: *mut f64,
) -> Status {
    // SAFETY: the caller's.
    let status = unsafe { with(instance, |i| i.step(from_s, step_s)) };
    // SAFETY: each is null or a place of its own.
    unsafe {
        for place in [event_needed, terminate, early] {
            if let Some(place) = place.as_mut() {
                *place = false;
            }
        }
        if let Some(place) = reached_s.as_mut() {
            *place = if status == OK {
                from_s + step_s
            } else {
                from_s
            };
        }
    }
    status
}

/// Functions of the standard that this kind of FMU has no use for: they take anything and answer with an error.
macro_rules! unused {
    ($($name:ident),+ $(,)?) => {
        $(
            #[doc = "Not of this kind of FMU: an error."]
            #[unsafe(no_mangle)]
            pub extern "C" fn $name(_instance: *mut c_void) -> Status {
                ERROR
            }
        )+
    };
}

unused! {
    fmi3EnterConfigurationMode,
    fmi3ExitConfigurationMode,
    fmi3EnterEventMode,
    fmi3EnterStepMode,
    fmi3UpdateDiscreteStates,
    fmi3EvaluateDiscreteStates,
    fmi3GetFloat32,
    fmi3GetInt8,
    fmi3GetUInt8,
    fmi3GetInt16,
    fmi3GetUInt16,
    fmi3GetInt32,
    fmi3GetUInt32,
    fmi3GetInt64,
    fmi3GetUInt64,
    fmi3GetBoolean,
    fmi3GetString,
    fmi3GetBinary,
    fmi3GetClock,
    fmi3SetFloat32,
    fmi3SetInt8,
    fmi3SetUInt8,
    fmi3SetInt16,
    fmi3SetUInt16,
    fmi3SetInt32,
    fmi3SetUInt32,
    fmi3SetInt64,
    fmi3SetUInt64,
    fmi3SetBoolean,
    fmi3SetString,
    fmi3SetBinary,
    fmi3SetClock,
    fmi3GetNumberOfVariableDependencies,
    fmi3GetVariableDependencies,
    fmi3GetFMUState,
    fmi3SetFMUState,
    fmi3FreeFMUState,
    fmi3SerializedFMUStateSize,
    fmi3SerializeFMUState,
    fmi3DeserializeFMUState,
    fmi3GetDirectionalDerivative,
    fmi3GetAdjointDerivative,
    fmi3GetIntervalDecimal,
    fmi3GetIntervalFraction,
    fmi3GetShiftDecimal,
    fmi3GetShiftFraction,
    fmi3SetIntervalDecimal,
    fmi3SetIntervalFraction,
    fmi3SetShiftDecimal,
    fmi3SetShiftFraction,
    fmi3GetOutputDerivatives,
    fmi3EnterContinuousTimeMode,
    fmi3CompletedIntegratorStep,
    fmi3SetTime,
    fmi3SetContinuousStates,
    fmi3GetContinuousStates,
    fmi3GetContinuousStateDerivatives,
    fmi3GetNominalsOfContinuousStates,
    fmi3GetEventIndicators,
    fmi3GetNumberOfEventIndicators,
    fmi3GetNumberOfContinuousStates,
    fmi3ActivateModelPartition,
}

/// Only co-simulation: null.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange() -> *mut c_void {
    std::ptr::null_mut()
}

/// Only co-simulation: null.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution() -> *mut c_void {
    std::ptr::null_mut()
}

#[cfg(test)]
mod tests;
