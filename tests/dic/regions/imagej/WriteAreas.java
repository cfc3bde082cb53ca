import ij.ImagePlus;
import ij.gui.*;
import ij.io.FileSaver;
import ij.io.RoiEncoder;
import ij.process.ByteProcessor;

/**
 * Wrote the files beside it by ImageJ: selections (.roi), and for areas the pixels that ImageJ counts in them
 * (.png). Compile and run with ij.jar on the class path, and name a folder that ends with a slash.
 */
public class WriteAreas {
  static String folder;

  static void area(String name, Roi roi) throws Exception {
    ImagePlus image = new ImagePlus("image", new ByteProcessor(80, 60));
    image.setRoi(roi);
    RoiEncoder.save(roi, folder + name + ".roi");
    new FileSaver(new ImagePlus("mask", image.createRoiMask())).saveAsPng(folder + name + ".png");
  }

  public static void main(String[] arguments) throws Exception {
    folder = arguments[0];
    area("polygon", new PolygonRoi(new int[] {10, 60, 70, 35, 12}, new int[] {5, 12, 50, 30, 55}, 5, Roi.POLYGON));
    area("rectangle", new Roi(7, 9, 41, 30));
    area("exact-rectangle", new Roi(7.3, 9.6, 41.2, 30.7));
    area("oval", new OvalRoi(5, 6, 60, 41));
    area("ellipse", new EllipseRoi(12, 12, 66, 46, 0.5));
    area("turned", new RotatedRectRoi(15, 40, 60, 15, 20));
    int[] x = {10, 30, 50, 62, 44, 20};
    int[] y = {8, 4, 20, 48, 55, 50};
    area("freehand", new PolygonRoi(x, y, 6, Roi.FREEROI));
    float[] exactX = {10.3f, 60.7f, 70.2f, 20.5f};
    float[] exactY = {5.6f, 12.1f, 50.4f, 55.9f};
    area("exact", new PolygonRoi(exactX, exactY, Roi.POLYGON));
    area("composite", new ShapeRoi(new Roi(10, 10, 50, 40)).not(new ShapeRoi(new Roi(20, 20, 15, 10))));
    ByteProcessor bright = new ByteProcessor(80, 60);
    bright.setColor(200);
    bright.fill(new OvalRoi(20, 12, 40, 37));
    Wand wand = new Wand(bright);
    wand.autoOutline(40, 30, 200.0, 200.0);
    area("traced", new PolygonRoi(wand.xpoints, wand.ypoints, wand.npoints, Roi.TRACED_ROI));
    RoiEncoder.save(new Line(3, 3, 40, 40), folder + "line.roi");
    RoiEncoder.save(new PointRoi(30, 30), folder + "point.roi");
    PolygonRoi spline = new PolygonRoi(new int[] {10, 60, 70, 35}, new int[] {5, 12, 50, 30}, 4, Roi.POLYGON);
    spline.fitSpline();
    RoiEncoder.save(spline, folder + "spline.roi");
    Roi rounded = new Roi(7, 9, 41, 30);
    rounded.setCornerDiameter(10);
    RoiEncoder.save(rounded, folder + "rounded.roi");
    RoiEncoder.save(new TextRoi(5, 5, "hello"), folder + "text.roi");
    System.exit(0);
  }
}
