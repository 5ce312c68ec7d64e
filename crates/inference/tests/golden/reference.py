"""Writes golden detections with ONNX Runtime, from the pixels that the crate's own tests decode:

    STILLPOINT_PIXELS=DIR cargo test -p stillpoint-inference --test all golden
    pip install onnx onnxruntime numpy pillow
    cd crates/inference/tests/golden
    MODELS=../../../../../shared/models
    python reference.py yolox $MODELS/yolox_nano_416.onnx 416x416 DIR > yolox_nano.csv
    python reference.py yolox $MODELS/yolox_nano_416.onnx 416x320 DIR > yolox_nano_416x320.csv
    python reference.py picodet $MODELS/picodet_s_416_coco.onnx 416x416 DIR > picodet_s.csv
    python reference.py picodet $MODELS/picodet_s_416_coco.onnx 416x320 DIR > picodet_s_416x320.csv

Independent of the Rust code but for the definitions: bilinear resize with half-pixel centres and no antialias, unrounded;
YOLOX at the upper left with padding 114 beside it, PicoDet stretched; planes B, G, R; the best class of each cell; suppression
per class above an intersection over union of 0.45; pixel (0, 0) centred at (0, 0); boxes cut to the image.
"""

import pathlib
import sys

import numpy as np
import onnx
import onnxruntime
from onnx import numpy_helper
from PIL import Image

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


def resize(rgb, w, h):
    height, width = rgb.shape[:2]
    x0, x1, fx = axis(width, w)
    y0, y1, fy = axis(height, h)
    a = rgb.astype(np.float32)
    rows = a[:, x0] * (1 - fx)[None, :, None] + a[:, x1] * fx[None, :, None]
    return rows[y0] * (1 - fy)[:, None, None] + rows[y1] * fy[:, None, None]


def planes(pixels):
    return pixels[:, :, ::-1].transpose(2, 0, 1)[None].copy()


class Yolox:
    """One output [1, cells, 85]; xy and wh relative to the cells of 8, 16 and 32 px."""

    def prepare(self, rgb, width, height):
        h, w = rgb.shape[:2]
        # Exact fractions: the scale is the smaller of width / w and height / h, sides are rounded down.
        if width * h <= height * w:
            sw, sh = width, h * width // w
        else:
            sw, sh = w * height // h, height
        out = np.full((height, width, 3), 114, np.float32)
        out[:sh, :sw] = resize(rgb, sw, sh)
        return planes(out), w / sw, h / sh

    def decode(self, outputs, width, height):
        raw = outputs[0][0]
        grids, strides = [], []
        for stride in (8, 16, 32):
            y, x = np.mgrid[: height // stride, : width // stride]
            grids.append(np.stack([x, y], 2).reshape(-1, 2))
            strides.append(np.full((x.size, 1), stride))
        grid, stride = np.concatenate(grids), np.concatenate(strides)
        centre = (raw[:, :2] + grid) * stride
        half = np.exp(raw[:, 2:4].astype(np.float64)) * stride / 2
        scores = raw[:, 4] * raw[:, 5:].max(1)
        return np.concatenate([centre - half, centre + half], 1), raw[:, 5:].argmax(1), scores


class PicoDet:
    """Four outputs [1, n, 80] of scores, then four [1, n, 32]: eight bins for each of left, top, right, bottom."""

    MEAN = np.array([103.53, 116.28, 123.675], np.float32).reshape(1, 3, 1, 1)
    STD = np.array([57.375, 57.12, 58.395], np.float32).reshape(1, 3, 1, 1)

    def prepare(self, rgb, width, height):
        h, w = rgb.shape[:2]
        return (planes(resize(rgb, width, height)) - self.MEAN) / self.STD, w / width, h / height

    def decode(self, outputs, width, height):
        boxes, classes, scores = [], [], []
        for level, stride in enumerate((8, 16, 32, 64)):
            score, bins = outputs[level][0], outputs[4 + level][0].astype(np.float64)
            columns, rows = -(-width // stride), -(-height // stride)
            assert score.shape == (rows * columns, 80) and bins.shape == (rows * columns, 32)
            weights = np.exp(bins.reshape(-1, 4, 8))
            distance = (weights * np.arange(8)).sum(2) / weights.sum(2) * stride
            y, x = np.divmod(np.arange(rows * columns), columns)
            centre = (np.stack([x, y], 1) + 0.5) * stride
            boxes.append(np.concatenate([centre - distance[:, :2], centre + distance[:, 2:]], 1))
            classes.append(score.argmax(1))
            scores.append(score.max(1))
        return np.concatenate(boxes), np.concatenate(classes), np.concatenate(scores)


def session(path, width, height):
    """The model for another input size: shapes taken out, and those in the constants of reshapes replaced."""
    model = onnx.load(path)
    graph = model.graph
    weights = {w.name: w for w in graph.initializer}
    inputs = [i for i in graph.input if i.name not in weights]
    dims = inputs[0].type.tensor_type.shape.dim
    old = [dims[2].dim_value, dims[3].dim_value]
    dims[2].dim_value, dims[3].dim_value = height, width
    del graph.input[:], graph.value_info[:]
    graph.input.extend(inputs)
    for output in graph.output:
        output.type.tensor_type.ClearField("shape")
    constants = dict(weights)
    constants.update({n.output[0]: n.attribute[0].t for n in graph.node if n.op_type == "Constant"})
    for node in graph.node:
        if node.op_type == "Reshape":
            tensor = constants[node.input[1]]
            shape = numpy_helper.to_array(tensor).copy()
            for stride in (4, 8, 16, 32):
                if shape[-2:].tolist() == [s // stride for s in old]:
                    shape[-2:] = [height // stride, width // stride]
                    tensor.CopyFrom(numpy_helper.from_array(shape, tensor.name))
                    break
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])


def iou(a, b):
    side = np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0)
    common = side.prod()
    return common / ((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - common)


def detect(network, head, rgb, width, height, threshold=0.25, overlap=0.45):
    pixels, sx, sy = head.prepare(rgb, width, height)
    outputs = network.run(None, {network.get_inputs()[0].name: pixels})
    boxes, classes, scores = head.decode(outputs, width, height)
    kept = []
    for i in np.argsort(-scores, kind="stable"):
        if scores[i] < threshold:
            break
        if not any(classes[j] == classes[i] and iou(boxes[j], boxes[i]) > overlap for j in kept):
            kept.append(i)
    limit = np.array([rgb.shape[1], rgb.shape[0]] * 2) - 0.5
    for i in kept:
        box = np.clip(boxes[i] * [sx, sy, sx, sy] - 0.5, -0.5, limit)
        if (box[2:] > box[:2]).all():
            yield NAMES[classes[i]], scores[i], box


def main():
    kind, path, size, folder = sys.argv[1:]
    width, height = map(int, size.split("x"))
    network, head = session(path, width, height), {"yolox": Yolox, "picodet": PicoDet}[kind]()
    print(f"# ONNX Runtime {onnxruntime.__version__}, by reference.py at {size}")
    print("image,class,score,x0,y0,x1,y1")
    for image in sorted(pathlib.Path(folder).glob("*.png")):
        rgb = np.asarray(Image.open(image).convert("RGB"))
        for name, score, box in detect(network, head, rgb, width, height):
            print(f"{image.stem},{name},{score:.6f}," + ",".join(f"{v:.4f}" for v in box))


if __name__ == "__main__":
    main()
