use super::*;
use crate::{token, variables};
use hydroline_rigs::Rig;
use std::sync::Mutex;

static HEARD: Mutex<Vec<String>> = Mutex::new(Vec::new());

unsafe extern "C" fn hear(_: *mut c_void, _: Status, _: *const c_char, words: *const c_char) {
    // SAFETY: the text of the call.
    HEARD
        .lock()
        .unwrap()
        .push(unsafe { text(words) }.to_owned());
}

fn instantiate(token: &str, folder: &Path) -> *mut c_void {
    let (token, folder) = (
        CString::new(token).unwrap(),
        CString::new(folder.to_str().unwrap()).unwrap(),
    );
    // SAFETY: texts that live until it returns.
    unsafe {
        fmi3InstantiateCoSimulation(
            c"one".as_ptr(),
            token.as_ptr(),
            folder.as_ptr(),
            false,
            false,
            false,
            false,
            std::ptr::null(),
            0,
            std::ptr::null_mut(),
            Some(hear),
            std::ptr::null(),
        )
    }
}

/// The whole life of an instance through C, as an importer leads it.
#[test]
fn an_importer_sets_steps_and_reads() {
    let rig = Rig::builtin("lshpi").unwrap();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("rig.toml"), &rig.effective_toml).unwrap();
    let one = instantiate(&token(&rig.effective_toml), folder.path());
    assert!(!one.is_null());
    let all = variables(&rig);
    let x = all.iter().find(|v| v.name == "x").unwrap().reference;
    let thrust = [4.0; 4];
    let references = [1u32, 2, 3, 4];
    let (mut flags, mut reached_s, mut value) = ([true; 3], 0.0, [0.0]);
    // SAFETY: an instance of this library, and places of this test.
    unsafe {
        assert_eq!(
            fmi3EnterInitializationMode(one, false, 0.0, 2.0, false, 0.0),
            OK
        );
        assert_eq!(
            fmi3SetFloat64(one, references.as_ptr(), 4, thrust.as_ptr(), 4),
            OK
        );
        assert_eq!(fmi3ExitInitializationMode(one), OK);
        for k in 0..20 {
            let from_s = 2.0 + 0.1 * f64::from(k);
            let [a, b, c] = &mut flags;
            assert_eq!(
                fmi3DoStep(one, from_s, 0.1, true, a, b, c, &mut reached_s),
                OK
            );
        }
        assert_eq!(fmi3GetFloat64(one, &x, 1, value.as_mut_ptr(), 1), OK);
    }
    let mut world = hydroline_sim::World::new(&rig, rig.tank.start_pose).unwrap();
    world
        .command_thrusts(0.0, &[4.0, 4.0, 4.0, 4.0, 0.0, 0.0, 0.0, 0.0])
        .unwrap();
    let expected = world.state_at(2.0).unwrap().eta[0];
    assert!(
        (value[0] - expected).abs() < 1e-12,
        "{} {expected}",
        value[0]
    );
    assert!((reached_s - 4.0).abs() < 1e-12 && flags == [false; 3]);
    // SAFETY: the same instance.
    unsafe {
        let unknown = 9999u32;
        assert_eq!(
            fmi3GetFloat64(one, &unknown, 1, value.as_mut_ptr(), 1),
            ERROR
        );
        assert_eq!(fmi3GetFloat64(one, &x, 1, value.as_mut_ptr(), 2), ERROR);
        assert_eq!(
            fmi3DoStep(
                std::ptr::null_mut(),
                0.0,
                1.0,
                true,
                std::ptr::null_mut(),
                std::ptr::null_mut(),
                std::ptr::null_mut(),
                std::ptr::null_mut()
            ),
            ERROR
        );
        assert_eq!(fmi3Reset(one), OK);
        fmi3FreeInstance(one);
    }
    assert!(instantiate("other", folder.path()).is_null());
    let heard = HEARD.lock().unwrap();
    assert!(heard.iter().any(|w| w.contains("9999")), "{heard:?}");
    assert!(heard.iter().any(|w| w.contains("two exports")), "{heard:?}");
}
