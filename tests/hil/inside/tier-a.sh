# Three cameras one after the other, the controller behind ftdi_sio at all three.
. /lib.sh
serial_on || exit 1
hydroline devices --json >/out/devices-serial.json 2>/out/devices.stderr

vivid_on || exit 1
hydroline devices --json >/out/devices-vivid.json 2>>/out/devices.stderr
record a-grey /work/rigs/a-grey.toml 7 --plan /work/rigs/hil-plan.toml
recorded a-grey 25
record a-yuyv /work/rigs/a-yuyv.toml 7 --plan /work/rigs/hil-plan.toml
recorded a-yuyv 25
rmmod vivid || exit 1

uvc_on 30 /out/uvc.txt || exit 1
hydroline devices --json >/out/devices-uvc.json 2>>/out/devices.stderr
record a-mjpg /work/rigs/a-mjpg.toml 7 --plan /work/rigs/hil-plan.toml
recorded a-mjpg 25
uvc_fault u
exit 0
