"""Writes golden detections with ONNX Runtime, from the pixels that the crate's own tests decode:

    STILLPOINT_PIXELS=DIR cargo test -p stillpoint-detection --features onnx --test onnx
    pip install onnxruntime numpy pillow
    python reference.py ../shared/models/yolox_nano_416.onnx DIR > crates/detection/tests/golden/yolox_nano.csv

Independent of the Rust code but for the definitions: bilinear resize with half-pixel centres and no antialias, unrounded;
padding 114 to the right and below; planes B, G, R; score = objectness * best class; suppression per class above an
intersection over union of 0.45; pixel (0, 0) centred at (0, 0); boxes cut to the image.
"""

import pathlib
import sys

import numpy as np
import onnxruntime
from PIL import Image

SIZE = 416
NAMES = """person;bicycle;car;motorcycle;airplane;bus;train;truck;boat;traffic light;fire hydrant;stop sign;parking meter;
bench;bird;cat;dog;horse;sheep;cow;elephant;bear;zebra;giraffe;backpack;umbrella;handbag;tie;suitcase;frisbee;skis;snowboard;
sports ball;kite;baseball bat;baseball glove;skateboard;surfboard;tennis racket;bottle;wine glass;cup;fork;knife;spoon;bowl;
banana;apple;sandwich;orange;broccoli;carrot;hot dog;pizza;donut;cake;chair;couch;potted plant;bed;dining table;toilet;tv;
laptop;mouse;remote;keyboard;cell phone;microwave;oven;toaster;sink;refrigerator;book;clock;vase;scissors;teddy bear;
hair drier;toothbrush""".replace("\n", "").split(";")


def axis(size, scaled):
    at = np.clip((np.arange(scaled) + 0.5) * size / scaled - 0.5, 0, size - 1)
    low = np.floor(at).astype(int)
    return low, np.minimum(low + 1, size - 1), (at - low).astype(np.float32)


def letterbox(rgb):
    height, width = rgb.shape[:2]
    longest = max(width, height)
    w, h = width * SIZE // longest, height * SIZE // longest
    x0, x1, fx = axis(width, w)
    y0, y1, fy = axis(height, h)
    a = rgb.astype(np.float32)
    rows = a[:, x0] * (1 - fx)[None, :, None] + a[:, x1] * fx[None, :, None]
    scaled = rows[y0] * (1 - fy)[:, None, None] + rows[y1] * fy[:, None, None]
    out = np.full((SIZE, SIZE, 3), 114, np.float32)
    out[:h, :w] = scaled
    return out[:, :, ::-1].transpose(2, 0, 1)[None].copy(), width / w, height / h


def decode(raw):
    grids, strides = [], []
    for stride in (8, 16, 32):
        n = SIZE // stride
        y, x = np.mgrid[:n, :n]
        grids.append(np.stack([x, y], 2).reshape(-1, 2))
        strides.append(np.full((n * n, 1), stride))
    grid, stride = np.concatenate(grids), np.concatenate(strides)
    centre = (raw[:, :2] + grid) * stride
    half = np.exp(raw[:, 2:4].astype(np.float64)) * stride / 2
    classes = raw[:, 5:].argmax(1)
    scores = raw[:, 4] * raw[:, 5:].max(1)
    return np.concatenate([centre - half, centre + half], 1), classes, scores


def iou(a, b):
    side = np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0)
    common = side.prod()
    return common / ((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - common)


def detect(session, rgb, threshold=0.25, overlap=0.45):
    planes, sx, sy = letterbox(rgb)
    raw = session.run(None, {session.get_inputs()[0].name: planes})[0][0]
    boxes, classes, scores = decode(raw)
    kept = []
    for i in np.argsort(-scores, kind="stable"):
        if scores[i] < threshold:
            break
        if not any(classes[j] == classes[i] and iou(boxes[j], boxes[i]) > overlap for j in kept):
            kept.append(i)
    height, width = rgb.shape[:2]
    limit = np.array([width, height, width, height]) - 0.5
    for i in kept:
        box = np.clip(boxes[i] * [sx, sy, sx, sy] - 0.5, -0.5, limit)
        if (box[2:] > box[:2]).all():
            yield NAMES[classes[i]], scores[i], box


def main():
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(sys.argv[1], options, providers=["CPUExecutionProvider"])
    print(f"# ONNX Runtime {onnxruntime.__version__}, by reference.py")
    print("image,class,score,x0,y0,x1,y1")
    for path in sorted(pathlib.Path(sys.argv[2]).glob("*.png")):
        rgb = np.asarray(Image.open(path).convert("RGB"))
        for name, score, box in detect(session, rgb):
            print(f"{path.stem},{name},{score:.6f}," + ",".join(f"{v:.4f}" for v in box))


if __name__ == "__main__":
    main()
