# Every fault of camera and serial line. at WORD = just before the fault is injected (..ed: the host has done it).
. /lib.sh
serial_on || exit 1

# --- one recording of vivid: error frames, frozen, fatal error, unbind and bind; serial: unplug, plug, silent ----------
vivid_on || exit 1
record c-vivid /work/rigs/c-vivid.toml 24 --plan /work/rigs/hil-plan-long.toml
sleep 1
for i in 1 2 3; do at vivid_error; vivid_control inject_v4l2_buf_flag_error=1; sleep 0.4; done
sleep 0.6
at serial_unplug; mark '{"adapter":"unplug"}'; at serial_unplugged
at vivid_freeze; vivid_control percentage_of_dropped_buffers=100
sleep 1.6
at vivid_thaw; vivid_control percentage_of_dropped_buffers=0
at serial_plug; mark '{"adapter":"plug"}'
wait_for 5 test -e /dev/ttyUSB0 || ls /dev/ttyUSB*
at serial_node
sleep 3
at vivid_fatal; vivid_control inject_fatal_streaming_error=1
sleep 2.5
at controller_stop; mark '{"controller":"stop"}'; at controller_stopped
sleep 1.2
at controller_cont; mark '{"controller":"cont"}'
sleep 1.5
at vivid_unbind; echo vivid.0 >/sys/bus/platform/drivers/vivid/unbind
sleep 1.5
echo vivid.0 >/sys/bus/platform/drivers/vivid/bind
wait_for 5 test -e /dev/video0
at vivid_node
recorded c-vivid 45
rmmod vivid || exit 1

# --- one recording of a UVC camera ------------------------------------------------------------------------------------
uvc_on 30 /out/uvc.txt || exit 1
record c-uvc /work/rigs/c-uvc.toml 22
sleep 1
at uvc_error; uvc_fault e; sleep 0.7
at uvc_truncated; uvc_fault t; sleep 0.7
at uvc_dropped; uvc_fault d; sleep 1.2
at uvc_silent; uvc_fault s; sleep 4
at uvc_halt; uvc_fault h; sleep 4
at uvc_unplug; uvc_fault u; sleep 1.5
uvc_on 30 /out/uvc.txt
at uvc_node
recorded c-uvc 45
uvc_fault u
exit 0
